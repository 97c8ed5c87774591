"""Mounts written from the protocol's paper alone: velocity servo, position servo, trajectory planner, and one
that is flexible and stands in the wind.

They judge. Each is a program that speaks UDP (`python bench/strangers/planner.py --help`) and a class for
virtual time. They share no code with the client, the package's simulator or each other, and must not come to:
whoever changes one reads the paper, and nothing of the client.
"""

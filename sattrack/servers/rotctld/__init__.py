"""Hamlib's rotctld protocol, version 1: requests, answers, and the mount as a rotator."""

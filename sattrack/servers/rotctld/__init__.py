"""Hamlib's rotctld protocol, version 1: requests, answers, and where the mount must be."""

"""The mount for other programs: each server with its protocol, its process and its loop."""

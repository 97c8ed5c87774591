"""The whole program in one virtual world, with faults of link, mount, host and people drawn from a seed."""

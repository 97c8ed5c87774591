"""The processes: the loop that feeds the mount, in real and in virtual time, and its channels."""

"""Control: status samples and target directions in, axis rates out; pure, no I/O, time as an argument."""

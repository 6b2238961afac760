"""Which columns of a log are its time."""

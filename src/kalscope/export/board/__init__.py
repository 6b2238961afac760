"""The running board: the commands that tune it, and the check that it computes what Kalscope does."""

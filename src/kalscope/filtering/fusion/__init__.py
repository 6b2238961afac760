"""Several sensors of one quantity in one filter: one state, and an update for each sensor that has a reading."""

"""Sensors of one kind: all fitted in one call, one filter for all, and which of them are unlike the others."""

"""Tuning: the chosen parameters, their file, and how they are applied to a recording."""

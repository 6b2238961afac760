"""What is in the folder of a fleet, finished or not: arrays to look at, and the recordings to open again."""

"""What is on the disk: the lock of the folder, the parts, the merged table."""

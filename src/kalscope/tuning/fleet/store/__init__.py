"""What is on disk: the lock of the folder, the parts, the merged table."""

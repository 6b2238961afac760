"""From the bytes of a file, or the lines of a port, to a Recording."""

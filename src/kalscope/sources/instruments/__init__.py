"""What the text files of known instruments and loggers say above, or beside, their table."""

"""Files that are no plain table of text, each read by its own rules or by a well-kept library."""

"""Files that are not plain text tables, each read by its own rules or by a well-maintained library."""

"""`estimate_many`: the compiled fit of many series, and the table of what it finds."""

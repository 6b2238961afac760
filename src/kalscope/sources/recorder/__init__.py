"""Lines of a board to a file that survives crashes."""

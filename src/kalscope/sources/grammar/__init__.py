"""What a cell, a stamp and a line of a log may be."""

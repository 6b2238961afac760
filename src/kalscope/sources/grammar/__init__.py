"""The forms of a cell, a stamp and a line of a log."""

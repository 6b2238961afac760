"""The forms of stamps in one cell: clocks, calendar stamps, and the odd ones. Pure functions on text."""

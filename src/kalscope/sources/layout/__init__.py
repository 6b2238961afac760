"""How one log is written: delimiter, header, columns, time column."""

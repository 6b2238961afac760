"""The lines of a log as rows: what their cells look like, how they may be split, where the table starts."""

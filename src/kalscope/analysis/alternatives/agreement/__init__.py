"""Second opinions on q and r: all methods side by side, and whether chance explains how they differ."""

"""One module per estimation method."""

"""Lines of text to rows of numbers, sans-I/O."""

"""q, r and momentum from a recording."""

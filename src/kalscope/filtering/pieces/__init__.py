"""A record that is filtered piece by piece: one that grows, or one that is kept at chosen samples only."""

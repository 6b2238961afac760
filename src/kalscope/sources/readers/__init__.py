"""Files to Recordings."""

"""Many recordings: one row each, one filter for all, and the devices that differ."""

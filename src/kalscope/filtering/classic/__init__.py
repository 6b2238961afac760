"""The classic filters, alone or behind a median, as a device runs them sample by sample."""

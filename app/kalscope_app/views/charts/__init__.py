"""The charts of the right panel."""

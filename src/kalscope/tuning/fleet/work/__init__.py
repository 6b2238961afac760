"""What a worker does: read a unit, fit its channels, write a part."""

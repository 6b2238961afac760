"""The filter: parameters, batch, streaming, smoothing, and its steady state."""

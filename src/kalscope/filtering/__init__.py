"""The filter: parameters, batch, streaming, smoothing, and what it settles to."""

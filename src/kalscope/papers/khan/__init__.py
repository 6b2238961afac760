"""Khan et al.: the single-dimensional generalized Kalman filter."""

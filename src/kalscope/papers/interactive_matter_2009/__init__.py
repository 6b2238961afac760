"""interactive matter (2009): filtering sensor data with a Kalman filter."""

"""Ma'arif et al. (2019): Kalman filter for noise reducer on sensor readings."""

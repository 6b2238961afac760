"""The Kalman filter over a record, one channel or several sensors, and the classic filters beside it."""

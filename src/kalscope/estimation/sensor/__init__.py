"""What is known of the sensor alone: its resolution, its noise, a stretch in which it is still."""

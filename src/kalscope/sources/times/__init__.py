"""From stamps to seconds: the time axis, its rate and its gaps."""

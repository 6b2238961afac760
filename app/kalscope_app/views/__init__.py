"""One small file for each part of the screen."""

"""The widgets, charts and pictures of the screen."""

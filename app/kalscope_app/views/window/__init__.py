"""The layout of the page: panels, sizes, style."""

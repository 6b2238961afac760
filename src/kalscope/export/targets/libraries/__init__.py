"""Filters of other projects: what runs the five lines, and what is refused with the nearest that it can do."""

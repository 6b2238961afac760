"""Logs written in random dialects, whose right reading is known."""

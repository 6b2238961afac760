"""The Source tab: open, generate, connect, record."""

"""The web guard: who may connect, and what a browser may send."""

"""A board that keeps sending: its newest samples, status and commands."""

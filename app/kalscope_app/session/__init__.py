"""What the user has chosen, as frozen values, and how it changes."""

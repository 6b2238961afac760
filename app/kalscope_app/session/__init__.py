"""What the user has chosen, and the changes that may be asked for. No viser here."""

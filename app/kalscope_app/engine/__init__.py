"""From State to Frame, on one thread. No viser here."""

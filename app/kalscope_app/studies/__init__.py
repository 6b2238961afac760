"""What is computed when the user pauses: checks, map, spectra, comparisons. No viser here."""

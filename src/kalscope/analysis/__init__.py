"""What a record and its residuals tell: diagnostics, spectrum, Allan deviation, simpler filters."""

"""Analysis of a record and its residuals: diagnostics, spectrum, Allan deviation, simpler filters."""

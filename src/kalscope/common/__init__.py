"""What every layer may use: files, progress, text."""

"""Where the noise sits: by frequency, and by averaging time."""

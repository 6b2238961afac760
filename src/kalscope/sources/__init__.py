"""Where samples come from: files, lines of text, serial ports, generators."""

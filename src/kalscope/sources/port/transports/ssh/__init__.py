"""ssh:// addresses: a serial port or a growing file of another machine, through the system's own ssh."""

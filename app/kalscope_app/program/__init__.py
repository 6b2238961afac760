"""The running program: log file, user settings, error reporting."""

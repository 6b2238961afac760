"""The Export tab: settings file, code, report."""

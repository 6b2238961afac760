"""The Export tab: code, tuning file, report, command line."""

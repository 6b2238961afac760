"""Spreadsheets: a sheet becomes lines of text, read by the ordinary rules."""

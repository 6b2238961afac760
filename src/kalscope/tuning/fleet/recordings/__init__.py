"""From what the user names to the units of work: files, lists of files, Parquet data sets."""

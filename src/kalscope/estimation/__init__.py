"""Find q and r: by estimation from a record, and from what the user knows; one module for each method."""

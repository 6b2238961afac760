"""What does not fit: the record behind a filter, the better parameters, the misfits, and their words."""

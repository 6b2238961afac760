"""The goal that q and r are chosen for: what can be asked for, the search, and its result."""

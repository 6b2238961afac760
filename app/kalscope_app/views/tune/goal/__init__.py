"""The goal that q and r are chosen for: what can be asked, the search, and what came of it."""

"""Changes of the State, each a checked function State -> State."""

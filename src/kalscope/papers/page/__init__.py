"""The page of `kalscope reproduce`: its prose, its two diagrams and its HTML."""

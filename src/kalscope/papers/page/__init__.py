"""The page of `kalscope reproduce`: its prose and its HTML."""

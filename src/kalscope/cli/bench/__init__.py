"""`kalscope bench`: speed against other libraries in the same run."""

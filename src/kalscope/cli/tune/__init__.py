"""`kalscope tune`: find q and r, and explain them."""

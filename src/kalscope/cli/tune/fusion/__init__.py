"""`kalscope tune --fuse`: several sensors of one quantity, their noises, and the filter that fuses them."""

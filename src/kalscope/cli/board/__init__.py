"""Commands that talk to a board, and a demo board for when there is none."""

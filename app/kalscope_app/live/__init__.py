"""The live board: its connection, its recording, what is sent to it."""

"""The live board beside the session: its connection, its recording, what is sent to it."""

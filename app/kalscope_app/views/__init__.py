"""What is on screen: every view draws a Frame and files requests; it never changes the session."""

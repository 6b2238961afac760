"""Transports that bring whole messages: datagrams, and the messages of a broker."""

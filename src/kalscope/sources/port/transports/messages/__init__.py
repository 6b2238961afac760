"""Transports of whole messages: datagrams, and the messages of a broker."""

"""Transports: one module for each kind of address, and the registry that knows them all."""

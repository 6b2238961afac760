"""Live ports of every kind of address: names, opening, reading."""

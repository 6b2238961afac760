"""Serial ports and pyserial URLs: names, opening, reading."""

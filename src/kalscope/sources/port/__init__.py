"""What streams lines: ports, files that grow, networks, brokers."""

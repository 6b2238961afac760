"""Logs of robots and drones: topics of messages, whose numeric fields become channels."""

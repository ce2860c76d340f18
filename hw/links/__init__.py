"""Byte links: in memory, serial, UDP, TCP."""

"""Bytes on the wires of the devices: pure functions both ways."""

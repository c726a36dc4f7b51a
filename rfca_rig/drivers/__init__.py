"""Devices as the engine asks for them, over the wire they really have."""

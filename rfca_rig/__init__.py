"""Runs the static and flapping experiments of a flexible leg, and compares them with a rigid-flexible multibody model."""

__version__ = "0.1.0"

"""Fits what the model believes of a rig to what was recorded of it."""

"""Torque-rotation curve of the hinges from static stages."""

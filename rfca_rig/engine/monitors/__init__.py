"""Limit checks of every tick, one module for each device or danger. Each raises Tripped, with the value and the limit."""

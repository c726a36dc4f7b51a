"""What is checked at every tick, a device or a danger each; each raises Tripped, with the value and the limit."""

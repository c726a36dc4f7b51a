"""Real-time server for the twins: sockets and pseudo terminals that any program can open."""

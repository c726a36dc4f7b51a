"""The twins as a server in real time: their wires end in sockets and pseudo terminals that any program can open."""

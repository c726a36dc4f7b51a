"""The other end of each wire: simulated devices that cannot be told from real ones by their bytes."""

"""The package's own entries of the catalogue, one file each."""

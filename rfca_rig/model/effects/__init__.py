"""The package's own entries of the catalogue, one module for each place. Every module lists its
own in `EFFECTS`.
"""

"""Recordings that other people published: a registry, the fetch of their source files, and
converters to the files of an experiment.

The package carries no recordings. The order of work:

1. `registry`: what is known about each set, its sources and its conversions, from TOML files.
2. `sources`: source files, fetched once and compared with their SHA-256.
3. `readers`: columns of the source files, one function for each form of file.
4. `conversion`: from columns to the CSV files of a set; `fingerprints.csv` has their expected size.
5. `library`: a set as a folder with `experiment.toml`. As `rr.datasets` it is public.
"""

"""The logbook: every run below a folder, how it ended, and the result of its diagnosis. Entry
point: `listing.list_runs`.

1. `listing` finds the folders, and takes from the index what is still valid.
2. `reading` reads the others, each into an `entry`.
3. `entry.RunQuery` selects.
"""

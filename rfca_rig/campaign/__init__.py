"""Recordings from other sources. Entry points: `opening.open_recordings` for the leg,
`experiment.read_experiment` for any mechanism.

`layout` describes the files; `reading` reads tables, `recorded_files` any kind of recording.
"""

"""Recordings and their files. Entry points: `store.read_recording`, `store.write_recording`, `run_folder` for runs under way.

1. `model` defines a recording; `blocks` are what the engine hands over.
2. `keeper` hands blocks to `process_keeper`'s own process, which writes the `journal` tick by tick.
3. `run_writer` turns finished stages into `stage_file`; `run_folder` joins all into `run.h5`, after a crash as well.
4. `seal` and `sums` check whether a file is as it was written.
"""

"""Recordings and their files. Entry points: `store.read_recording`, `store.write_recording`,
`run_folder` for runs under way.

1. `model` defines a recording; `journal` has the blocks that the engine hands over.
2. `backend` passes the blocks to `recorder_process`, which writes the `journal` tick by tick.
3. `run_writer` turns finished stages into `stage_file`; `run_folder` joins all into `run.h5`, after
   a crash as well.
4. `hdf5_file` (its seal) and `layout` (its sums) check whether a file is as it was written.
"""

"""Unfinished runs of an older version: a folder `run.h5.partial` with one small recording per stroke or stage."""

from dataclasses import replace
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_folder import merge_stages
from rfca_rig.recording.run_text import INTERRUPTED
from rfca_rig.recording.store import read_recording, write_recording

PARTIAL = ".partial"


def partial_of(path: Path) -> Path:
    """The folder with the parts of an unfinished recording; `path` is where the finished file would be."""
    return path.with_name(path.name + PARTIAL)


def read_partial(path: Path) -> Recording:
    """Everything that was recorded of a run that never finished; its provenance says so."""
    parts = [read_recording(part) for part in sorted(partial_of(path).glob("*.h5"))]
    if not parts:
        raise BadInput(f"{partial_of(path)}: holds no recording; the run was interrupted before it began")
    found = merge_stages(parts[0], parts[1:])
    interruption = f"the run ended without being finished, after {len(found.strokes)} strokes and {len(found.static)} static stages"
    return replace(found, provenance={**found.provenance, INTERRUPTED: interruption})


def recover_partial(path: Path) -> Path:
    """Makes `path` from its partial folder, with every part in it. Returns `path`.

    Where `path` was already complete at the crash, only the leftovers are removed: a recording is never overwritten.
    """
    if path.is_file():
        # Reads all of it: the parts are removed only if the file is sound.
        read_recording(path)
    else:
        write_recording(read_partial(path), path)
    for file in partial_of(path).iterdir():
        file.unlink()
    partial_of(path).rmdir()
    return path

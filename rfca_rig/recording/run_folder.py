"""A run's folder before, after and without its writer: made, read, put together into `run.h5`, brought back after a crash."""

import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import refusals, remove, sync_folder
from rfca_rig.recording.ballast import Ballast
from rfca_rig.recording.form import Recording
from rfca_rig.recording.layout import HEADER, RECORDING, STAGES, WRITING, journals, stage_files
from rfca_rig.recording.run_lock import check_over
from rfca_rig.recording.run_text import events_text, read_ending, read_header, write_header
from rfca_rig.recording.stage_file import stage_in, write_stage
from rfca_rig.recording.store import read_recording, write_recording
from rfca_rig.recording.sums import read_sums, write_sums

INTERRUPTED = "interrupted"


def create(folder: Path, header: Recording) -> None:
    """Begins a run: the folder with `run.json` and the ballast in it, on disk when this returns.

    `header` gives title, source, believed, known_to and provenance. Raises BadInput where there is a run already, RigError when the
    disk refuses.
    """
    if (folder / HEADER).exists() or (folder / RECORDING).exists():
        raise BadInput(f"{folder}: holds a run already; recordings are never written over, choose another place")
    with refusals(folder, "cannot be made"):
        (folder / STAGES).mkdir(parents=True, exist_ok=True)
    write_header(folder, header)
    Ballast(folder).lay()
    sync_folder(folder.parent)


def discard(folder: Path) -> None:
    """Takes everything away again; for a run that ended before it recorded anything."""
    shutil.rmtree(folder)


def is_run(folder: Path) -> bool:
    return (folder / HEADER).is_file()


def read_stages(folder: Path) -> Recording:
    """Everything that the run recorded so far, from its stage files; of a run that has not ended, its provenance says so.

    Raises BadInput, naming the file, where one is damaged.
    """
    header, ending = read_header(folder), read_ending(folder)
    found = merged(header, (read_recording(file) for file in stage_files(folder)))
    known = {**header.provenance, "events": events_text(folder)}
    if ending is None:
        said = f"the run ended without being finished, after {len(found.strokes)} strokes and {len(found.static)} static stages"
        return replace(found, provenance={**known, INTERRUPTED: said})
    static = found.static if ending.static is None else ending.static
    return replace(found, static=static, provenance={**known, **ending.provenance})


def merged(header: Recording, stages: Iterable[Recording]) -> Recording:
    """The header with the stages in their order."""
    parts = list(stages)
    return replace(
        header,
        strokes=header.strokes + tuple(stroke for part in parts for stroke in part.strokes),
        static=header.static + tuple(stage for part in parts for stage in part.static),
        raw=header.raw + tuple(stage for part in parts for stage in part.raw),
    )


def build(folder: Path) -> Path:
    """Puts `run.h5` together from the other files, the same bytes every time, and sums up all. Returns its path."""
    path = write_recording(read_stages(folder), folder / RECORDING)
    write_sums(folder)
    return path


def close_journals(folder: Path) -> int:
    """After a crash: makes stage files of what was in progress, takes away the ballast and what was half written.

    Returns how many journals there were. Raises BadInput where the run is still going on.
    """
    check_over(folder)
    header, found = read_header(folder), journals(folder)
    for journal in found:
        path = journal.with_suffix(".h5")
        stage = None if path.is_file() else stage_in(journal, header)
        if stage is not None:
            write_stage(stage, path)
        remove(journal)
    for half in folder.rglob(f"*{WRITING}"):
        remove(half)
    Ballast(folder).release()
    return len(found)


def is_whole(folder: Path) -> bool:
    """Whether nothing is left to be brought back: `run.h5` can be read, nothing is in progress, and all is summed up."""
    if journals(folder):
        return False
    try:
        read_recording(folder / RECORDING)
        return bool(read_sums(folder))
    except BadInput:
        return False

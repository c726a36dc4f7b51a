"""Finds the folders of runs, and detects cheaply whether one has changed."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.recording.layout import DIAGNOSIS, ENDING, EVENTS, EXPERIMENT, HEADER, PENDULUM, RECORDING

MARKER_FILES = (HEADER, ENDING, EVENTS, RECORDING, PENDULUM, EXPERIMENT)
# Levels of folders that are searched below the folder of all runs.
MAX_DEPTH = 6


@dataclass(frozen=True)
class FoundRun:
    """A run's folder, as a path from the folder of all runs, and a stamp that changes whenever one of its files does.

    `diagnoses` are paths in it where a diagnosis may be.
    """

    folder: str
    stamp: str
    diagnoses: tuple[str, ...] = ()


def find_runs(runs: Path) -> Iterator[FoundRun]:
    """Every folder with a run, at any depth up to MAX_DEPTH; folders inside a run are not searched."""
    yield from _below(str(runs), "", MAX_DEPTH)


def _below(runs: str, folder: str, deeper: int) -> Iterator[FoundRun]:
    try:
        with os.scandir(os.path.join(runs, folder)) as listing:  # noqa: PTH118  (thousands of folders: paths as objects take as long again)
            inside = list(listing)
    except OSError:  # taken away meanwhile, or not ours to read
        return
    # One listing per folder serves both questions: is it a run, and has it changed.
    files = {one.name: one for one in inside if one.name in MARKER_FILES}
    if {HEADER, RECORDING, PENDULUM, EXPERIMENT} & set(files):
        telling = [files[name] for name in MARKER_FILES if name in files]
        if EXPERIMENT in files:  # any file in the folder may be a recording
            telling += sorted((one for one in inside if one.name not in MARKER_FILES and _is_file(one)), key=lambda one: one.name)
        yield FoundRun(folder or ".", "|".join(map(_stamp, telling)), tuple(_diagnoses(inside)))
        return
    for one in inside:
        if deeper and not one.name.startswith(".") and _is_folder(one) and not _leads_back(one):
            yield from _below(runs, f"{folder}/{one.name}" if folder else one.name, deeper - 1)


def _is_folder(one: "os.DirEntry[str]") -> bool:
    """A link that leads to itself is neither a folder nor a file."""
    try:
        return one.is_dir()
    except OSError:
        return False


def _is_file(one: "os.DirEntry[str]") -> bool:
    try:
        return one.is_file()
    except OSError:
        return False


def _leads_back(one: "os.DirEntry[str]") -> bool:
    """Whether it is a link to a folder that contains it: following it would list every run again and again."""
    return one.is_symlink() and Path(one.path).parent.resolve().is_relative_to(Path(one.path).resolve())


def _diagnoses(inside: "list[os.DirEntry[str]]") -> Iterator[str]:
    for one in inside:
        if one.name == DIAGNOSIS:
            yield one.path
        elif one.name.startswith("diag") and _is_folder(one):
            yield f"{one.path}/{DIAGNOSIS}"


def _stamp(file: "os.DirEntry[str]") -> str:
    """Name, time, size and inode: a file that replaced another has another inode, even with the same age and size."""
    try:
        status = file.stat()
    except OSError:
        return f"{file.name}:gone"
    return f"{file.name}:{status.st_mtime_ns}:{status.st_size}:{status.st_ino}"

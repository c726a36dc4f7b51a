"""Folders that are there as a whole or not at all, also where two processes write the same one."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

ENDING = ".writing"


@contextmanager
def whole(folder: Path) -> Iterator[Path]:
    """A path to write the folder at; it gets its name at the end of the block.

    Where somebody else was faster, as a worker that had been given up for lost, what is there stays.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.{token_hex(4)}{ENDING}")
    try:
        yield partial
        if not folder.is_dir():
            partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def sweep_out(folder: Path) -> None:
    """Clears away what was being written when an earlier process was ended."""
    for partial in folder.glob(f".*{ENDING}"):
        shutil.rmtree(partial, ignore_errors=True)


def see_afresh(folder: Path) -> None:
    """A disk that several computers share may remember for half a minute that a file was not there: until the folder is changed here."""
    mark = folder / f".seen-{token_hex(4)}"
    mark.touch()
    mark.unlink()

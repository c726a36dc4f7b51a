"""Folders that are complete or absent, also where two processes write the same one."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

ENDING = ".writing"


@contextmanager
def atomic_directory(folder: Path) -> Iterator[Path]:
    """Yields a path to write the folder at; it gets its final name at the end of the block.

    Where another process was faster, for example a worker that counted as lost, the existing folder stays.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    # A random part, not the process id: workers on several computers may share the disk.
    partial = folder.with_name(f".{folder.name}.{token_hex(4)}{ENDING}")
    try:
        yield partial
        if not folder.is_dir():
            partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def remove_leftovers(folder: Path) -> None:
    """Removes what earlier processes were writing when they ended."""
    for partial in folder.glob(f".*{ENDING}"):
        shutil.rmtree(partial, ignore_errors=True)


def refresh_nfs_cache(folder: Path) -> None:
    """Makes a network disk show new files: it may remember for half a minute that they were absent, until the folder is changed here."""
    mark = folder / f".seen-{token_hex(4)}"
    mark.touch()
    mark.unlink()

"""Files that are either there and whole, or not there: written beside the target, forced to disk, then renamed."""

import os
from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import RigError


def write_atomically(path: Path, content: bytes) -> None:
    """Puts `content` at `path`; what stood there stays until the new file is on disk. Raises RigError when the disk refuses.

    Beside the target, because a rename is atomic only within one file system.
    """
    partial = path.with_name(path.name + ".writing")
    try:
        _write(partial, content)
        partial.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        raise RigError(f"{path}: {1e-6 * len(content):.1f} MB cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Forces the folder's list of names to disk: without it a rename may be lost with the power. Windows has no such call."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def make_folder_atomically(folder: Path, fill: Callable[[Path], object]) -> None:
    """Makes `folder`, with what `fill` writes into it, all or nothing; folders above it are made, and taken away on failure.

    `folder` must not exist. Whatever `fill` raises passes on after everything is cleared away.
    """
    made = [above for above in folder.parents if not above.exists()]
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.writing-{os.getpid()}")
    try:
        partial.mkdir()
        fill(partial)
        partial.rename(folder)
        sync_folder(folder.parent)
    except BaseException:
        _remove(partial)
        for above in made:
            above.rmdir()
        raise


def _remove(folder: Path) -> None:
    if folder.is_dir():
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()

"""Callbacks of options that check, before the work, whether results can be written to the given place."""

import os
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import refuse_devices


def out_folder(folder: Path | None) -> Path | None:
    """The folder unchanged, if it exists and is writable, or can be made. Raises BadInput."""
    if folder is None:
        return None
    # A folder that does not exist yet is made below its nearest existing parent, which must be writable.
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise BadInput(f"{folder}: {'is' if nearest == folder else f'{nearest} is'} a file, where a folder is needed; name another")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise BadInput(f"{folder}: nothing may be written into {nearest}; name another folder, or make that one yours")
    return folder


def out_file(file: Path | None) -> Path | None:
    """The file unchanged, if it can be written. Raises BadInput."""
    if file is None:
        return None
    if file.is_dir():
        raise BadInput(f"{file}: is a folder, where a file is needed; name a file in it")
    refuse_devices(file)
    if not file.parent.is_dir():
        raise BadInput(f"{file}: there is no folder {file.parent}; make it, or name another file")
    if not os.access(file if file.exists() else file.parent, os.W_OK):
        raise BadInput(f"{file}: may not be written; name another file, or make that one yours")
    return file

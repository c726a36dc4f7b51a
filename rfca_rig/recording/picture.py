"""Photos of static stages as files: PNG, which loses nothing."""

import importlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.atomic import write_atomically

FOLDER = "photos"
PACKING = 1  # of 0 to 9: noise hardly packs, and more takes many times longer
Picture = NDArray[np.uint8]


def next_photo(folder: Path) -> int:
    """The number of the run's next photo."""
    return max((int(file.stem) for file in (folder / FOLDER).glob("*.png") if file.stem.isdecimal()), default=0) + 1


def photo_name(number: int) -> str:
    """The path from the run's folder."""
    return f"{FOLDER}/{number:03d}.png"


def write_picture(path: Path, picture: Picture) -> None:
    """Returns when the picture (rows, columns, 3) is on disk. Raises RigError, DiskFull."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2 = importlib.import_module("cv2")  # as late as this: the recorder of a run without camera starts sooner
    packed = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])[1]
    write_atomically(path, packed.tobytes())

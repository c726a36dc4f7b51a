"""Photos of static stages as PNG files, which are lossless."""

import importlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import PHOTOS

# PNG compression, 0 to 9: camera noise hardly compresses, and a higher level takes many times longer.
PACKING = 1
Picture = NDArray[np.uint8]


def next_photo(folder: Path) -> int:
    """Number of the run's next photo."""
    return max((int(file.stem) for file in (folder / PHOTOS).glob("*.png") if file.stem.isdecimal()), default=0) + 1


def photo_name(number: int) -> str:
    """Path of a photo in the run's folder."""
    return f"{PHOTOS}/{number:03d}.png"


def write_picture(path: Path, picture: Picture) -> None:
    """Returns when the picture (rows, columns, 3) is on disk. Raises RigError, DiskFull."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Imported only here: the recorder of a run without camera starts sooner.
    cv2 = importlib.import_module("cv2")
    encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])[1]
    write_atomically(path, encoded.tobytes())

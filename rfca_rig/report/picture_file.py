"""Writes a picture to a file whose ending decides the format."""

from io import BytesIO
from pathlib import Path

from matplotlib.figure import Figure

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically

FORMATS = (".svg", ".png", ".pdf")


def check_picture_path(path: Path) -> None:
    """Raises BadInput where the ending is not one of FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise BadInput(f"{path}: a picture ends in {', '.join(FORMATS)}; give --picture {path.stem or 'picture'}.svg")


def save_picture(figure: Figure, path: Path) -> None:
    """Writes the figure, all or nothing; the same figure gives the same bytes. Raises RigError where the disk refuses."""
    drawn, kind = BytesIO(), path.suffix.lower()
    # Without its date, an SVG has the same bytes each time.
    figure.savefig(drawn, format=kind.lstrip("."), dpi=200, metadata={"Date": None} if kind == ".svg" else None)
    write_atomically(path, drawn.getvalue())

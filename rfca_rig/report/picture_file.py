"""Writes a picture to a file whose ending decides the format."""

from pathlib import Path

from matplotlib.figure import Figure

from rfca_rig.errors import BadInput

FORMATS = (".svg", ".png", ".pdf")


def check_picture_path(path: Path) -> None:
    """Raises BadInput where the ending is not one of FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise BadInput(f"{path}: a picture ends in {', '.join(FORMATS)}; give --picture {path.stem or 'picture'}.svg")


def save_picture(figure: Figure, path: Path) -> None:
    """Writes the figure; the same figure gives the same bytes. Raises BadInput where the file cannot be written."""
    # Without its date, an SVG has the same bytes each time.
    try:
        figure.savefig(path, dpi=200, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None

"""Pictures that a command writes to a file whose ending decides the format."""

from pathlib import Path

from matplotlib.figure import Figure

from rfca_rig.errors import BadInput

FORMATS = (".svg", ".png", ".pdf")


def check_picture_path(path: Path) -> None:
    """BadInput where the ending names no format that can be drawn."""
    if path.suffix.lower() not in FORMATS:
        raise BadInput(f"{path}: a picture ends in {', '.join(FORMATS)}; give --picture {path.stem or 'picture'}.svg")


def save_picture(figure: Figure, path: Path) -> None:
    """The same bytes for the same figure. Raises BadInput where the file cannot be written."""
    try:
        figure.savefig(path, dpi=200, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None

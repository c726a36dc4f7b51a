"""Long lines of a drawing in fewer bytes: each point as its step from the one before."""

import re
from itertools import pairwise

LINE = re.compile(r' d="(M [\d. ML\n-]{400,}?)\s*"')  # a short one is not worth it
POINT = re.compile(r"[ML] (-?[\d.]+) (-?[\d.]+)")


def with_light_paths(svg: str) -> str:
    """The same picture; coordinates with one decimal, as `inline_svg` gives them, stay exact."""
    return LINE.sub(lambda found: f' d="{_in_steps(found[1])}"', svg)


def _in_steps(path: str) -> str:
    """Pieces of a broken line begin anew with M."""
    return "".join(_piece(piece) for piece in re.split(r"(?=M)", path) if piece)


def _piece(piece: str) -> str:
    points = [(round(10.0 * float(x)), round(10.0 * float(y))) for x, y in POINT.findall(piece)]
    steps = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(points)]
    return f"M{_tenths(points[0])}l{' '.join(_tenths(step) for step in steps)}" if steps else ""


def _tenths(pair: tuple[int, int]) -> str:
    return " ".join(_number(tenths) for tenths in pair).replace(" -", "-")


def _number(tenths: int) -> str:
    whole, tenth = divmod(abs(tenths), 10)
    said = (str(whole) if whole or not tenth else "") + (f".{tenth}" if tenth else "")
    return f"-{said}" if tenths < 0 else said

"""Compression of long SVG paths: each point is written as its step from the previous one."""

import re
from itertools import pairwise

# Paths of 400 characters or more; on shorter ones little is saved.
LINE = re.compile(r' d="(M [\d. ML\n-]{400,}?)\s*"')
POINT = re.compile(r"[ML] (-?[\d.]+) (-?[\d.]+)")


def compress_paths(svg: str) -> str:
    """The same drawing in fewer bytes; coordinates with one decimal, as `inline_svg` gives them, stay exact."""
    return LINE.sub(lambda found: f' d="{_in_steps(found[1])}"', svg)


def _in_steps(path: str) -> str:
    """Path in relative steps; each piece of an interrupted line begins with M."""
    return "".join(_piece(piece) for piece in re.split(r"(?=M)", path) if piece)


def _piece(piece: str) -> str:
    # In whole tenths: sums of steps are then exact, however long the line is.
    points = [(round(10.0 * float(x)), round(10.0 * float(y))) for x, y in POINT.findall(piece)]
    steps = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(points)]
    return f"M{_tenths(points[0])}l{' '.join(_tenths(step) for step in steps)}" if steps else ""


def _tenths(pair: tuple[int, int]) -> str:
    return " ".join(_number(tenths) for tenths in pair).replace(" -", "-")


def _number(tenths: int) -> str:
    whole, tenth = divmod(abs(tenths), 10)
    text = (str(whole) if whole or not tenth else "") + (f".{tenth}" if tenth else "")
    return f"-{text}" if tenths < 0 else text

"""How every picture of every page looks: colours that mean one thing everywhere, line widths, sizes of letters.

Measured is a dark thin line over simulated, a broad lighter one: apart in greyscale and for every kind of colour vision, both at least
3 : 1 against the paper and against each other (WCAG 2, graphics), and both seen where they coincide.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl

MEASURED = "#173f6b"
SIMULATED = "#d07f0e"
SIMULATED_EDGE = "#7a4500"
OTHER = "#9a3a6a"  # the model before, another form of a law; always dashed besides
BAD = "#b34a00"  # failed, false, over a limit
ALIKE = "#8fa9c6"
PALE = "#e4e0d8"
FAINT = "#8a8a8a"
PAPER = "#fffefb"

STYLE: dict[Any, Any] = {
    "font.size": 9.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "path.simplify": False,
}
SMALL = 8.2


@contextmanager
def drawing() -> Iterator[None]:
    """Within it figures look alike on every machine: a reader's own matplotlibrc must not change a page."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def colours() -> dict[str, str]:
    """By the names that templates and the style sheet use."""
    return {
        "measured": MEASURED,
        "simulated": SIMULATED,
        "edge": SIMULATED_EDGE,
        "other": OTHER,
        "bad": BAD,
        "alike": ALIKE,
        "pale": PALE,
        "faint": FAINT,
        "paper": PAPER,
    }

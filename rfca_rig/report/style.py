"""Common style of all figures: colours with one meaning everywhere, line widths, font sizes.

Measured is a dark thin line over simulated, a broad lighter one. The two differ in greyscale and for every kind of colour vision. Both have
a contrast of at least 3 : 1 to the paper and to each other (WCAG 2, graphics), and both remain visible where they coincide.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl

MEASURED = "#173f6b"
SIMULATED = "#d07f0e"
SIMULATED_EDGE = "#7a4500"
# The model before a fit, or another form of a law; always dashed as well.
OTHER = "#9a3a6a"
# Failed, false, beyond a limit.
BAD = "#b34a00"
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
    # Lines are decimated by `envelope`, which keeps every peak; no further point may be dropped.
    "path.simplify": False,
}
SMALL = 8.2


@contextmanager
def drawing() -> Iterator[None]:
    """Context in which figures look alike on every machine: a user's own matplotlibrc must not change a page."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def colours() -> dict[str, str]:
    """Colours by the names that templates and the style sheet use."""
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

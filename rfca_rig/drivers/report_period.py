"""Does a drive report as often as the settings say? A wrong period would stretch the time base of a whole recording."""

from collections.abc import Callable

LOOK_REPORTS = 20
LOOKS = 3  # reports that were held up somewhere, or a program that was, make one look too few or too many
MOST_APART = 2.0


def period_fault(look_s: Callable[[], float], set_s: float) -> float | None:
    """The period (s) at which the reports come where that is not `set_s`, None where it is.

    `look_s` watches `LOOK_REPORTS` periods and returns the mean one. A wrong period is so each time one looks.
    """
    seen_s = set_s
    for _ in range(LOOKS):
        seen_s = look_s()
        if set_s / MOST_APART < seen_s < set_s * MOST_APART:
            return None
    return seen_s

"""Check of a drive's report period against the settings. A wrong one would stretch the time base of a whole recording."""

from collections.abc import Callable

PERIODS_PER_ATTEMPT = 20
# One measurement may be wrong, if reports or this program were delayed. A wrong setting is wrong every time.
MAX_ATTEMPTS = 3
# Factor between measured and configured period from which the setting is refused.
MAX_PERIOD_RATIO = 2.0


def find_wrong_period(look_s: Callable[[], float], set_s: float) -> float | None:
    """The measured report period in s if it differs from `set_s` by a factor of two, None if it agrees.

    `look_s` watches `PERIODS_PER_ATTEMPT` periods and returns the mean one. The period is wrong only if every measurement says so.
    """
    measured_s = set_s
    for _ in range(MAX_ATTEMPTS):
        measured_s = look_s()
        if set_s / MAX_PERIOD_RATIO < measured_s < set_s * MAX_PERIOD_RATIO:
            return None
    return measured_s

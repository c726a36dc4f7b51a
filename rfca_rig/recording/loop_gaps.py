"""The gaps of the control loop in a recording, over all parts of a run, in words.

Recordings of versions that did not count them have none.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rfca_rig.engine.loop_gaps import GapHistogram, add_histograms

KEY = "loop_gaps_ms"
LONGEST_KEY = "worst_loop_gap_ms"
WATCHDOG_KEY = "watchdog_ms"
# The share of ticks that the words are about: of a stroke of 2 s, all but one.
SHARE = 0.999


@dataclass(frozen=True)
class RecordedGaps:
    """Counts of the gaps, the longest one, and the time without a command after which the drive
    removes its torque; None where the recording does not state it.
    """

    histogram: GapHistogram
    longest_ms: float
    watchdog_ms: float | None

    def text(self) -> str:
        """One line, such as "99.9 % of 2431 ticks within 2.4 ms; longest 7.0 ms"."""
        bound_ms = self.histogram.bound_ms(SHARE)
        # No tick can be above the longest one, though its bin ends there.
        if bound_ms is None or bound_ms > self.longest_ms:
            bound_ms = self.longest_ms
        text = (
            f"{100 * SHARE:g} % of {self.histogram.ticks} ticks within {bound_ms:.1f} ms; longest "
            f"{self.longest_ms:.1f} ms"
        )
        if self.watchdog_ms is not None:
            text += f"; the watchdog is {self.watchdog_ms:g} ms"
        return text


def recorded_gaps(provenance: Mapping[str, str]) -> RecordedGaps | None:
    """The gaps of a run with all its parts; None where they were not recorded."""
    parts = [*_earlier_endings(provenance.get("resumed", "[]")), provenance]
    histograms = []
    longest_ms = 0.0
    for part in parts:
        histogram = _parse(part.get(KEY))
        if histogram is None:
            continue
        histograms.append(histogram)
        longest_ms = max(longest_ms, _number(part.get(LONGEST_KEY)) or 0.0)
    total = add_histograms(histograms)
    if not total.ticks:
        return None
    return RecordedGaps(total, longest_ms, _number(provenance.get(WATCHDOG_KEY)))


def _earlier_endings(resumed: str) -> Iterator[Mapping[str, object]]:
    """What the ends of the parts before each continuation state."""
    events = _from_json(resumed)
    if not isinstance(events, list):
        return
    for event in events:
        if isinstance(event, dict) and isinstance(event.get("ending"), dict):
            yield event["ending"]


def _parse(text: object) -> GapHistogram | None:
    """None where the text is no table of counts, as in files of other programs."""
    stated = _from_json(text)
    if not isinstance(stated, dict):
        return None
    counts: dict[float, int] = {}
    for edge, count in stated.items():
        edge_ms = _number(edge)
        if edge_ms is None or not isinstance(count, int) or count < 0:
            return None
        counts[edge_ms] = count
    return GapHistogram(dict(sorted(counts.items())))


def _from_json(text: object) -> object:
    if not isinstance(text, str):
        return None
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _number(text: object) -> float | None:
    if not isinstance(text, str):
        return None
    try:
        value = float(text)
    except ValueError:
        return None
    if math.isfinite(value) and value >= 0.0:
        return value
    return None

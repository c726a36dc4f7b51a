"""The figure of one tracked value: the change in each run with its interval, and a clear trend."""

from dataclasses import dataclass
from datetime import datetime

import numpy as np
from matplotlib.axis import XAxis
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from rfca_rig.escaping import html_text
from rfca_rig.reports.history.result import INTERVAL_STDS, RigHistory, describe_change, words_of
from rfca_rig.reports.style import (
    FAINT,
    MEASURED,
    NARROW_IN,
    SIMULATED,
    WIDTH_IN,
    Hover,
    drawing,
    for_both_widths,
    inline_svg,
    make_panel,
)

HEIGHT_IN = 2.1
# matplotlib counts days since 1970.
DAY_S = 86400.0


@dataclass(frozen=True)
class TrackedValue:
    """One value of a history."""

    history: RigHistory
    name: str


@for_both_widths
def draw_value(value: TrackedValue, is_narrow: bool) -> str:
    """The changes of a value over time, as inline SVG."""
    history = value.history
    unit = history.units[value.name]
    changes = [run.changes[value.name] for run in history.runs]
    when = np.array([run.began_s for run in history.runs]) / DAY_S
    middle = np.array([change.value for change in changes])
    half = INTERVAL_STDS * np.array([change.std for change in changes])
    width_in = NARROW_IN if is_narrow else WIDTH_IN
    words = words_of(value.name)
    with drawing():
        quantity = ", ".join(filter(None, ("change since the reference", unit)))
        figure, axes = make_panel(quantity, "", (width_in, HEIGHT_IN))
        axes.axhline(0.0, color=FAINT, lw=0.8)
        axes.errorbar(
            when, middle, half, fmt="o", color=MEASURED, ms=3.2, elinewidth=0.9, capsize=0.0
        )
        trend = history.clear_trends.get(value.name)
        if trend is not None:
            axes.plot(when, trend.fitted, color=SIMULATED, lw=2.2, zorder=0)
        _label_dates(axes.xaxis)
        axes.margins(x=0.03)
        hovers = _list_hovers(figure, value, when, middle, half)
        label = html_text(f"Change of {words} since the reference, by run")
        return inline_svg(figure, f"{value.name} {is_narrow}", label, hovers)


def _label_dates(axis: XAxis) -> None:
    """Ticks at round dates or times, in the time of this place."""
    zone = datetime.now().astimezone().tzinfo
    # Fewer than eight fit on a phone.
    locator = AutoDateLocator(tz=zone, minticks=3, maxticks=7)  # type: ignore[no-untyped-call]
    words = ConciseDateFormatter(locator, tz=zone)  # type: ignore[no-untyped-call]
    axis.set_major_locator(locator)
    axis.set_major_formatter(words)


def _list_hovers(
    figure: Figure,
    value: TrackedValue,
    when: np.ndarray,
    middle: np.ndarray,
    half: np.ndarray,
) -> list[Hover]:
    """What a pointer shows at each run."""
    (axes,) = figure.axes
    unit = value.history.units[value.name]
    width = 0.01 * (float(np.ptp(when)) or 1.0)
    hovers = []
    for number, run in enumerate(value.history.runs):
        text = f"{run.folder}: {describe_change(middle[number], half[number], unit)}"
        hovers.append(Hover(axes, when[number] - width, when[number] + width, text))
    return hovers

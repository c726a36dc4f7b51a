"""The history of a rig: the values of its runs over time, with their trends."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from scipy import stats

from rfca_rig.diagnosis.reference.history import INTERVAL, Trend, fit_trend
from rfca_rig.diagnosis.result import Value
from rfca_rig.model.declarations.changes import CHANGES
from rfca_rig.reports.text import decimals, number

FORMAT = "rfca-history/1"
PERCENT = "%"
# Half of an interval in standard deviations of a normal error.
INTERVAL_STDS = float(stats.norm.ppf(0.5 + 0.5 * INTERVAL))


@dataclass(frozen=True)
class TrackedRun:
    """One run: its folder, when it began in seconds since 1970, and by name the changes of all
    values.
    """

    folder: str
    began_s: float
    changes: Mapping[str, Value]


@dataclass(frozen=True)
class RigHistory:
    """Runs of one rig in the order of time.

    Parameters
    ----------
    rig
        The rig and the specimen, in words.
    reference
        Folders of the reference's runs.
    units
        Unit of each tracked value by its name.
    runs
        The runs.
    left_out
        Of each run that could not be compared, its folder and the reason.
    """

    rig: str
    reference: tuple[str, ...]
    units: Mapping[str, str]
    runs: tuple[TrackedRun, ...]
    left_out: tuple[tuple[str, str], ...] = ()

    @cached_property
    def trends(self) -> dict[str, Trend | None]:
        """The trend of each value; None where the runs are too few for one."""
        began_s = [run.began_s for run in self.runs]
        trends = {}
        for name in self.units:
            changes = [run.changes[name] for run in self.runs]
            trends[name] = fit_trend(began_s, changes, len(self.units))
        return trends

    @property
    def clear_trends(self) -> dict[str, Trend]:
        """Those that chance would hardly make."""
        return {name: trend for name, trend in self.trends.items() if trend and trend.is_clear}

    def sentence(self) -> str:
        """What the history says, in one sentence."""
        if all(trend is None for trend in self.trends.values()):
            return "Too few runs for a trend."
        if not self.clear_trends:
            return "No value has a trend."
        stated = "; ".join(self.describe_trend(name) for name in self.clear_trends)
        return f"From the first run to the last: {stated}."

    def describe_trend(self, name: str) -> str:
        """The trend of a value with its interval."""
        trend = self.trends[name]
        if trend is None:
            return "too few runs"
        amount = describe_change(trend.change, trend.half_width, self.units[name])
        return f"{words_of(name)} {amount}"

    def plain(self) -> dict[str, Any]:
        """Everything as plain data, for JSON."""
        values = {}
        for name, trend in self.trends.items():
            values[name] = {
                "unit": self.units[name],
                "trend": None if trend is None else asdict(trend),
            }
        runs = []
        for run in self.runs:
            changes = {
                name: {"value": change.value, "std": change.std}
                for name, change in run.changes.items()
            }
            runs.append({"run": run.folder, "began_s": run.began_s, "changes": changes})
        return {
            "format": FORMAT,
            "rig": self.rig,
            "reference": list(self.reference),
            "interval": INTERVAL,
            "sentence": self.sentence(),
            "values": values,
            "runs": runs,
            "left_out": [{"run": run, "why": why} for run, why in self.left_out],
        }


def words_of(name: str) -> str:
    """A tracked value in words."""
    return CHANGES[name].left_out.removeprefix("another value of ")


def describe_change(change: float, half_width: float, unit: str) -> str:
    """A change with half of its interval, both to the decimals that the interval has."""
    digits = max(decimals(half_width, 2), 0)
    shown = number(change, digits)
    sign = "+" if change > 0.0 else ""
    return f"{sign}{shown} \u00b1 {number(half_width, digits)} {unit}".rstrip()

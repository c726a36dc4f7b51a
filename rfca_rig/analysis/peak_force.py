"""The peak of a stroke: the sample with the largest force on the sensor in the plane of motion, as
in the paper's impact test.

The paper gives fy and fz "at the peak test point", so both belong to one instant; their own
extremes may lie elsewhere in the stroke. The peak is a single sample and may be the touchdown
spike. A parabola over 20 ms, as used for the valley, would flatten a spike of 1 ms.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.matched_simulation import MatchedSimulation
from rfca_rig.analysis.phases import Undetermined
from rfca_rig.analysis.repeats import Spread, compute_spread
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PeakForce:
    """The largest |F| = sqrt(fy^2 + fz^2) of a stroke, its time from the commanded start, and fy
    and fz at that instant.
    """

    time_s: float
    force_N: float
    fy_N: float
    fz_N: float


@dataclass(frozen=True)
class PeakSpread:
    """The peaks of several strokes: mean and standard deviation (n - 1) of each value."""

    time_s: Spread
    force_N: Spread
    fy_N: Spread
    fz_N: Spread


@dataclass(frozen=True)
class PeakForceRow:
    """One condition. `simulated_touching`: whether the model's leg has ground contact at its peak,
    None where it has no peak.

    `refused` lists the strokes without a peak and the reasons; `repeats` counts those with one.
    """

    source: str
    height_m: float
    speed_rad_s: float
    shaft_speed_rad_s: float
    measured: PeakSpread
    simulated: PeakSpread
    simulated_touching: bool | None
    refused: tuple[str, ...]

    @property
    def repeats(self) -> int:
        return self.measured.force_N.count


def find_peak(t_s: Floats, fy_N: Floats, fz_N: Floats) -> PeakForce | Undetermined:
    """The sample with the largest force after the commanded start, or why there is none.

    Parameters
    ----------
    t_s : (m,) ascending, in s from the commanded start
    fy_N, fz_N : (m,) in N, in the sensor's axes

    References
    ----------
    The paper's section IV.A, impact test.
    """
    # Samples before the start show the load at rest, and missing ones are NaN.
    moving = np.flatnonzero((t_s >= 0.0) & np.isfinite(fy_N) & np.isfinite(fz_N))
    if not len(moving):
        return Undetermined("no sample of fy and fz after the start")
    at = int(moving[np.hypot(fy_N[moving], fz_N[moving]).argmax()])
    return PeakForce(
        float(t_s[at]), float(np.hypot(fy_N[at], fz_N[at])), float(fy_N[at]), float(fz_N[at])
    )


def stroke_peak(stroke: Stroke) -> PeakForce | Undetermined:
    """The peak of a recorded stroke. Needs fy and fz on one time base."""
    for stream in stroke.streams.values():
        if "fy_N" in stream.columns and "fz_N" in stream.columns:
            return find_peak(
                stream.t_s, stream.columns["fy_N"].values, stream.columns["fz_N"].values
            )
    # fy and fz must be of one instant, so they are not interpolated between time bases.
    missing = [name for name in ("fy", "fz") if stroke.channel(f"{name}_N") is None]
    if missing:
        return Undetermined(f"{' and '.join(missing)} not recorded")
    return Undetermined("fy and fz have different time bases")


def make_peak_row(compared: ComparedCondition, source: str) -> PeakForceRow:
    """The row of one condition; `source` names the recording.

    The simulation lasts longer than the recording, so its peak is searched up to the end of the
    longest recorded stroke.
    """
    strokes = compared.condition.strokes
    end_s = max(float(stream.t_s[-1]) for stroke in strokes for stream in stroke.streams.values())
    measured = [stroke_peak(stroke) for stroke in strokes]
    simulated = [(model, _find_simulated_peak(model, end_s)) for model in compared.simulated]
    peaks = [(model, peak) for model, peak in simulated if isinstance(peak, PeakForce)]
    speeds = [model.shaft_speed_rad_s for model in compared.simulated]
    touching = None
    if peaks:
        model, peak = peaks[0]
        touching = _touching(model, peak.time_s)
    return PeakForceRow(
        source=source,
        height_m=compared.condition.height_m,
        speed_rad_s=compared.condition.speed_rad_s,
        shaft_speed_rad_s=sum(speeds) / len(speeds),
        measured=_spread_of_peaks([peak for peak in measured if isinstance(peak, PeakForce)]),
        simulated=_spread_of_peaks([peak for _, peak in peaks]),
        simulated_touching=touching,
        refused=tuple(
            f"repeat {stroke.repeat}: {peak.reason}"
            for stroke, peak in zip(strokes, measured, strict=True)
            if isinstance(peak, Undetermined)
        ),
    )


def _find_simulated_peak(model: MatchedSimulation, end_s: float) -> PeakForce | Undetermined:
    stroke = model.stroke
    shown = stroke.t_s <= end_s
    return find_peak(stroke.t_s[shown], stroke.fy_N[shown], stroke.fz_N[shown])


def _touching(model: MatchedSimulation, time_s: float) -> bool:
    return bool(model.stroke.normal_N[int(np.searchsorted(model.stroke.t_s, time_s))].any())


def _spread_of_peaks(peaks: list[PeakForce]) -> PeakSpread:
    return PeakSpread(
        time_s=compute_spread([peak.time_s for peak in peaks]),
        force_N=compute_spread([peak.force_N for peak in peaks]),
        fy_N=compute_spread([peak.fy_N for peak in peaks]),
        fz_N=compute_spread([peak.fz_N for peak in peaks]),
    )

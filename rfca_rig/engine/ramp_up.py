"""First strokes at reduced speed: their measured forces predict the force at full speed before it is run."""

from collections.abc import Mapping

from rfca_rig.errors import Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Limits, Stage
from rfca_rig.trip_codes import Trip


class RampUp:
    """Remembers the peaks of first strokes, condition by condition.

    The load at full speed is extrapolated in three ways: in the ratio of the model's loads, linearly in the speed (momentum of an impact),
    and linearly in its square (energy of an impact). The largest counts. It is an estimate, not a bound: the limits are checked in motion
    as always. The linear ways need two first strokes of different speeds.
    """

    def __init__(self, limits: Limits, expected: Mapping[Stage, Load]) -> None:
        self._limits = limits
        self._expected = expected
        strokes = [(stage, load) for stage, load in expected.items() if isinstance(stage, Flap | Cycles)]
        self._at_full = {(stage.height_m, stage.speed_rad_s): load for stage, load in strokes}
        self._peaks: dict[tuple[float, float], list[tuple[float, Load]]] = {}

    def take(self, stage: Approach, peak: Load) -> None:
        """Adds a finished first stroke. Raises Tripped where the prediction for full speed passes a limit."""
        condition = (stage.height_m, stage.full_speed_rad_s)
        self._peaks.setdefault(condition, []).append((stage.speed_rad_s, peak))
        predicted = self.predict_full_speed(stage, peak)
        if predicted.force_N > self._limits.force_N or predicted.torque_Nm > self._limits.torque_Nm:
            raise Tripped(
                Trip.FULL_SPEED_TOO_MUCH,
                f"{stage.label} brought {peak.force_N:.0f} N and {peak.torque_Nm:.1f} N m, which foretells {predicted.force_N:.0f} N and "
                f"{predicted.torque_Nm:.1f} N m at full speed; limits {self._limits.force_N:g} N and {self._limits.torque_Nm:g} N m; "
                "raise the rack or go slower",
            )

    def predict_full_speed(self, stage: Approach, peak: Load) -> Load:
        """Predicted load at the full speed of the condition, from all of its first strokes so far."""
        peaks = self._peaks.get((stage.height_m, stage.full_speed_rad_s), [(stage.speed_rad_s, peak)])
        return Load(
            self._largest(stage, [(speed, load.force_N) for speed, load in peaks], self._model_ratio(stage, "force_N")),
            self._largest(stage, [(speed, load.torque_Nm) for speed, load in peaks], self._model_ratio(stage, "torque_Nm")),
        )

    def _largest(self, stage: Approach, peaks: list[tuple[float, float]], ratio: float) -> float:
        full, (speed, value) = stage.full_speed_rad_s, peaks[-1]
        # The peak itself is among them: a prediction for a higher speed must never be below what was measured.
        estimates = [value, ratio * value]
        # Two strokes at one speed give no slope.
        if len(peaks) > 1 and peaks[-2][0] != speed:
            before, earlier = peaks[-2]
            estimates.append(value + (value - earlier) * (full - speed) / (speed - before))
            estimates.append(value + (value - earlier) * (full**2 - speed**2) / (speed**2 - before**2))
        return max(estimates)

    def _model_ratio(self, stage: Approach, of: str) -> float:
        here, there = self._expected.get(stage), self._at_full.get((stage.height_m, stage.full_speed_rad_s))
        if here is None or there is None or not getattr(here, of):
            # Without a prediction of the model, or with one of zero load, the ratio is not defined: the other two
            # ways remain.
            return 1.0
        return float(getattr(there, of) / getattr(here, of))

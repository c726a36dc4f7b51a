"""First strokes at reduced speed: what force will the full speed bring? Asked before it is run, answered from what was measured."""

from collections.abc import Mapping

from rfca_rig.errors import Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Limits, Stage
from rfca_rig.trip_codes import Trip


class RampUp:
    """Remembers the peaks of first strokes, condition by condition.

    The force at full speed is foretold three ways: in proportion to the model's, linear in the speed, and linear in its square, as
    the momentum of an impact and its energy go. The largest counts. It is no bound: the limits are watched in flight as ever.
    """

    def __init__(self, limits: Limits, expected: Mapping[Stage, Load]) -> None:
        self._limits = limits
        self._expected = expected
        strokes = [(stage, load) for stage, load in expected.items() if isinstance(stage, Flap | Cycles)]
        self._at_full = {(stage.height_m, stage.speed_rad_s): load for stage, load in strokes}
        self._seen: dict[tuple[float, float], list[tuple[float, Load]]] = {}

    def take(self, stage: Approach, peak: Load) -> None:
        """A first stroke is done. Raises Tripped where the speed that is to come would pass a limit."""
        condition = (stage.height_m, stage.full_speed_rad_s)
        self._seen.setdefault(condition, []).append((stage.speed_rad_s, peak))
        foretold = self.foretold(stage, peak)
        if foretold.force_N > self._limits.force_N or foretold.torque_Nm > self._limits.torque_Nm:
            raise Tripped(
                Trip.FULL_SPEED_TOO_MUCH,
                f"{stage.label} brought {peak.force_N:.0f} N and {peak.torque_Nm:.1f} N m, which foretells {foretold.force_N:.0f} N and "
                f"{foretold.torque_Nm:.1f} N m at full speed; limits {self._limits.force_N:g} N and {self._limits.torque_Nm:g} N m; "
                "raise the rack or go slower",
            )

    def foretold(self, stage: Approach, peak: Load) -> Load:
        """The load at the full speed of the condition, from all of its first strokes so far."""
        seen = self._seen.get((stage.height_m, stage.full_speed_rad_s), [(stage.speed_rad_s, peak)])
        return Load(
            self._largest(stage, [(speed, load.force_N) for speed, load in seen], self._model_ratio(stage, "force_N")),
            self._largest(stage, [(speed, load.torque_Nm) for speed, load in seen], self._model_ratio(stage, "torque_Nm")),
        )

    def _largest(self, stage: Approach, seen: list[tuple[float, float]], ratio: float) -> float:
        full, (speed, value) = stage.full_speed_rad_s, seen[-1]
        ways = [value, ratio * value]
        if len(seen) > 1 and seen[-2][0] != speed:
            before, earlier = seen[-2]
            ways.append(value + (value - earlier) * (full - speed) / (speed - before))
            ways.append(value + (value - earlier) * (full**2 - speed**2) / (speed**2 - before**2))
        return max(ways)

    def _model_ratio(self, stage: Approach, of: str) -> float:
        here, there = self._expected.get(stage), self._at_full.get((stage.height_m, stage.full_speed_rad_s))
        if here is None or there is None or not getattr(here, of):
            return 1.0
        return float(getattr(there, of) / getattr(here, of))

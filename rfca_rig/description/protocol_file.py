"""A protocol file (protocols/*.toml): the experiment, independent of the rig. `read_plan` makes
it a plan for a rig.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from rfca_rig.description.sections import SpeedRadS
from rfca_rig.errors import BadInput
from rfca_rig.protocol.experiments import (
    CheckSettings,
    Fatigue,
    Flapping,
    PlannedCondition,
    RigFacts,
    StaticStages,
    fatigue_plan,
    flapping_plan,
    static_plan,
)
from rfca_rig.protocol.plan import Direction, Plan, SettleCriterion
from rfca_rig.toml import Positive, Section, place_of, read_data, read_toml

HeightMm = Annotated[float, Field(gt=0, le=1000)]
Reversal = Annotated[float, Field(ge=0, le=20)]


class SettleSection(Section):
    """Settled when 50 ms means of force and angle stay within these bands, peak to peak, for
    `for_s`. The wait ends after `limit_s`.
    """

    force_band_N: Positive = Field(description="largest change of force, peak to peak")
    angle_band_deg: Positive = Field(description="largest change of angle, peak to peak")
    for_s: Annotated[float, Field(ge=0.1, le=60)] = Field(
        description="how long both stay within their bands"
    )
    limit_s: Annotated[float, Field(gt=0, le=3600)] = Field(description="longest wait")

    def criterion(self) -> SettleCriterion:
        return SettleCriterion(
            self.force_band_N, float(np.radians(self.angle_band_deg)), self.for_s, self.limit_s
        )


class ConditionSection(Section):
    """One height of the shaft above the ground and one speed."""

    height_mm: HeightMm = Field(description="height of the shaft above the ground")
    speed_rad_s: SpeedRadS = Field(description="speed of the shaft")


class DynamicFile(Section):
    """The dynamic experiment: strokes against the ground."""

    experiment: Literal["dynamic"]
    title: str = Field(description="name of the protocol")
    repeats: Annotated[int, Field(ge=1, le=1_000_000)] = Field(description="strokes per condition")
    sweep_deg: Annotated[float, Field(gt=0, le=330)] = Field(
        description="angle that the shaft turns in a stroke"
    )
    return_speed_rad_s: SpeedRadS = Field(description="speed of the way back")
    settle: SettleSection
    conditions: Annotated[tuple[ConditionSection, ...], Field(min_length=1, strict=False)]

    def flapping(self) -> Flapping:
        """The experiment in SI units."""
        return Flapping(
            title=self.title,
            conditions=tuple(
                PlannedCondition(condition.height_mm / 1e3, condition.speed_rad_s)
                for condition in self.conditions
            ),
            repeats=self.repeats,
            sweep_rad=float(np.radians(self.sweep_deg)),
            return_speed_rad_s=self.return_speed_rad_s,
            settle=self.settle.criterion(),
        )


class StageSection(Section):
    """One shaft angle, and whether the leg is loaded or unloaded there; `reversal_deg` for this
    stage alone.
    """

    angle_deg: Annotated[float, Field(ge=0, le=180)] = Field(description="shaft angle")
    direction: Literal["loading", "unloading"] = Field(
        default="loading", description="loading or unloading"
    )
    reversal_deg: Reversal | None = Field(default=None, description="turn back after this stage")


class StaticFile(Section):
    """Static stages of the shaft angle at fixed heights.

    Once settled, a stage waits `dwell_s`, averages over `average_s`, and takes its `photo` where
    the rig has a camera. After each stage the shaft turns back by `reversal_deg` and is held there
    as a stage of its own. The difference between both shows the friction at the floor.
    """

    experiment: Literal["static"]
    title: str = Field(description="name of the protocol")
    heights_mm: Annotated[tuple[HeightMm, ...], Field(min_length=1, strict=False)] = Field(
        description="heights of the shaft above the ground"
    )
    move_speed_rad_s: SpeedRadS = Field(description="speed between stages")
    average_s: Annotated[float, Field(ge=0.05, le=600)] = Field(
        description="duration of the average"
    )
    dwell_s: Annotated[float, Field(ge=0, le=600)] = Field(
        default=0.0, description="wait after settling"
    )
    photo: bool = Field(default=True, description="take a photo of each stage")
    reversal_deg: Reversal = Field(default=0.0, description="turn back after each stage")
    settle: SettleSection
    stages: Annotated[tuple[StageSection, ...], Field(min_length=1, strict=False)]

    def static_stages(self) -> StaticStages:
        """The experiment in SI units."""
        return StaticStages(
            title=self.title,
            heights_m=tuple(height_mm / 1e3 for height_mm in self.heights_mm),
            angles_rad=tuple(
                (float(np.radians(angle_deg)), direction)
                for stage in self.stages
                for angle_deg, direction in self._angles_held(stage)
            ),
            move_speed_rad_s=self.move_speed_rad_s,
            settle=self.settle.criterion(),
            average_s=self.average_s,
            dwell_s=self.dwell_s,
            photo=self.photo,
        )

    def _angles_held(self, stage: StageSection) -> list[tuple[float, Direction]]:
        """Angles at which a stage holds the shaft: its own angle, and the one after the
        reversal.
        """
        back_deg = stage.reversal_deg
        if back_deg is None:
            back_deg = self.reversal_deg
        if not back_deg:
            return [(stage.angle_deg, stage.direction)]
        # Turning back reverses the direction: unloading after loading, and the other way round.
        if stage.direction == "loading":
            turned_back: tuple[float, Direction] = (stage.angle_deg - back_deg, "unloading")
        else:
            turned_back = (stage.angle_deg + back_deg, "loading")
        return [(stage.angle_deg, stage.direction), turned_back]


class CheckSection(Section):
    """[check]: after every `every` cycles the shaft is held at `angles_deg`. The run ends where
    the forces there have drifted too far.
    """

    every: Annotated[int, Field(ge=1)] = Field(description="cycles between two checks")
    angles_deg: Annotated[
        tuple[Annotated[float, Field(ge=0, le=180)], ...], Field(min_length=1, strict=False)
    ] = Field(description="shaft angles of a check")
    move_speed_rad_s: SpeedRadS = Field(description="speed between them")
    average_s: Annotated[float, Field(ge=0.05, le=600)] = Field(
        description="duration of the average"
    )
    dwell_s: Annotated[float, Field(ge=0, le=600)] = Field(
        default=0.0, description="wait before it"
    )
    drift_percent: Annotated[float, Field(gt=0, le=100)] = Field(
        description="change of force that ends the run"
    )

    def check(self) -> CheckSettings:
        angles_rad = tuple(float(np.radians(angle_deg)) for angle_deg in self.angles_deg)
        return CheckSettings(
            self.every,
            angles_rad,
            self.move_speed_rad_s,
            self.dwell_s,
            self.average_s,
            self.drift_percent / 100.0,
        )


class FatigueFile(Section):
    """Bending cycles at one height. Each cycle gives a row of numbers, and every `full_every`-th
    a stroke with all its samples.
    """

    experiment: Literal["fatigue"]
    title: str = Field(description="name of the protocol")
    height_mm: HeightMm = Field(description="height of the shaft above the ground")
    speed_rad_s: SpeedRadS = Field(description="speed of the shaft")
    cycles: Annotated[int, Field(ge=1, le=1_000_000_000)] = Field(description="number of cycles")
    full_every: Annotated[int, Field(ge=1)] = Field(
        description="record all samples of every n-th cycle"
    )
    sweep_deg: Annotated[float, Field(gt=0, le=330)] = Field(
        description="angle that the shaft turns in a cycle"
    )
    return_speed_rad_s: SpeedRadS = Field(description="speed of the way back")
    settle: SettleSection
    check: CheckSection

    def fatigue(self) -> Fatigue:
        """The experiment in SI units."""
        return Fatigue(
            title=self.title,
            height_m=self.height_mm / 1e3,
            speed_rad_s=self.speed_rad_s,
            cycles=self.cycles,
            full_every=self.full_every,
            sweep_rad=float(np.radians(self.sweep_deg)),
            return_speed_rad_s=self.return_speed_rad_s,
            settle=self.settle.criterion(),
            check=self.check.check(),
        )


def read_fatigue(path: Path) -> FatigueFile:
    """Read the fatigue protocol in `path`. Raises BadInput, with file and line, where it cannot
    be used.
    """
    return read_toml(path, FatigueFile)


def read_dynamic(path: Path) -> DynamicFile:
    """Read the dynamic protocol in `path`. Raises BadInput, with file and line, where it cannot
    be used.
    """
    return read_toml(path, DynamicFile)


def read_static(path: Path) -> StaticFile:
    """Read the static protocol in `path`. Raises BadInput, with file and line, where it cannot
    be used.
    """
    return read_toml(path, StaticFile)


PROTOCOLS: Mapping[str, Callable[[Path], DynamicFile | StaticFile | FatigueFile]] = {
    "dynamic": read_dynamic,
    "static": read_static,
    "fatigue": read_fatigue,
}

PLANS: Mapping[str, Callable[[Path, RigFacts], Plan]] = {
    "dynamic": lambda path, facts: flapping_plan(read_dynamic(path).flapping(), facts),
    "static": lambda path, facts: static_plan(read_static(path).static_stages(), facts),
    "fatigue": lambda path, facts: fatigue_plan(read_fatigue(path).fatigue(), facts),
}


def read_plan(path: Path, facts: RigFacts) -> Plan:
    """The plan of the protocol in `path`. Raises BadInput, with file and line, where it cannot
    be used.
    """
    experiment = read_data(path).get("experiment")
    if not isinstance(experiment, str) or experiment not in PLANS:
        where = f"{path}"
        if experiment is not None:
            where = place_of(path, ("experiment",))
        raise BadInput(
            f"{where}: experiment = {experiment!r}; a protocol says one of "
            f"{', '.join(map(repr, PLANS))}"
        )
    return PLANS[experiment](path, facts)

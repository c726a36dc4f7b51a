"""The next experiment on a leg: strokes at a height and speed, or static stages at a height, within
the limits of the rig.

A proposal becomes the protocol file that `rfca-rig dynamic run` and `rfca-rig static run` take.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.phases import Undetermined
from rfca_rig.analysis.repeats import Condition
from rfca_rig.bench.expectation import predict_loads
from rfca_rig.description.protocol_file import DynamicFile, StaticFile
from rfca_rig.diagnosis.experiment_design.choice import (
    SET_UP_MIN,
    ExperimentDesign,
    OpenHypotheses,
    Option,
    list_open_hypotheses,
    list_options,
    propose,
)
from rfca_rig.diagnosis.leg.findings import LegFindings
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.shaft_observations import SIGNAL, ShaftCondition, make_shaft_condition
from rfca_rig.diagnosis.leg.simulator import select_tables
from rfca_rig.diagnosis.leg.stages import MEAN_OF_SAMPLES, StageTable, make_stage_tables
from rfca_rig.diagnosis.leg.strokes import (
    FORCES,
    STROKE_TOLERANCE,
    DynamicCondition,
    ShaftTurn,
    make_dynamic_condition,
)
from rfca_rig.escaping import toml_comment
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.experiments import RigFacts, static_plan
from rfca_rig.protocol.plan import Limits, Rates
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.model import Column, StaticStage, Stream, Stroke
from rfca_rig.toml import format_value, table, validate

NEXT_PROTOCOL = "next-experiment.toml"
# Settling and speeds as in protocols/static-angle.toml and protocols/flapping.toml
STATIC: Mapping[str, Any] = {
    "move_speed_rad_s": 0.4,
    "average_s": 0.5,
    "settle": {"force_band_N": 0.1, "angle_band_deg": 0.05, "for_s": 0.5, "limit_s": 15.0},
}
DYNAMIC: Mapping[str, Any] = {
    "sweep_deg": 200.0,  # from the start angle through the ground and up again
    # at most: a stroke's speed is within the limits, a greater one may not be
    "return_speed_rad_s": 3.0,
    "settle": {"force_band_N": 0.3, "angle_band_deg": 0.2, "for_s": 0.3, "limit_s": 10.0},
}

REPEATS = (3, 5, 10)  # strokes of one condition: from a quick look to a usual series
GRID = 4  # heights, and speeds: the ends of the range and two between
HEIGHT_BEYOND_M = 0.020  # the rack may go this far beyond where it has been
SLOWEST_RAD_S = 1.0  # of strokes; what is slower is left to static stages
READABLE_RAD_S = 5.0  # at greater speeds a stroke's phases are not found
LIMIT_SHARE = 0.9  # share of a stated limit that an expectation may reach
# height, and share of the speed: conditions nearer than both show the same
ALIKE_M = 0.004
ALIKE_SPEED = 0.15
REST_S = 1.5  # usual time until the leg is at rest
# shaft angles in degrees; a bent leg wedges when it is pushed back by more than some degrees
SEQUENCES = {
    "static": (60.0, 75.0, 90.0, 105.0, 120.0, 135.0),
    "slow reversal": (90.0, 105.0, 120.0, 135.0, 133.0, 131.0, 129.0, 131.0, 133.0, 135.0),
    "hold": (60.0, *[120.0] * 6),
}


def make_protocol(proposal: Mapping[str, Any]) -> DynamicFile | StaticFile:
    """The protocol of a proposal with "height_mm", and "speed_rad_s" or "stages". Raises
    BadInput where no rig can do it.
    """
    title = "next experiment"
    height_mm = proposal["height_mm"]
    if "speed_rad_s" not in proposal:
        static = {
            "experiment": "static",
            "title": title,
            "heights_mm": [height_mm],
            **STATIC,
            "stages": proposal["stages"],
        }
        return validate(static, StaticFile, f"the {title}")
    speed_rad_s = proposal["speed_rad_s"]
    repeats = proposal.get("repeats", 1)
    # A return that is faster than the stroke could exceed the limits of the rig.
    back = {"return_speed_rad_s": min(DYNAMIC["return_speed_rad_s"], speed_rad_s)}
    conditions = [{"height_mm": height_mm, "speed_rad_s": speed_rad_s}]
    dynamic = {
        "experiment": "dynamic",
        "title": title,
        "repeats": repeats,
        **DYNAMIC,
        **back,
        "conditions": conditions,
    }
    return validate(dynamic, DynamicFile, f"the {title}")


def write_next_protocol(folder: Path, proposal: Mapping[str, Any] | None) -> Path | None:
    """Write the protocol of a proposal into `folder`; where none is proposed for the rig, remove
    an old one. Raises RigError.
    """
    path = folder / NEXT_PROTOCOL
    if proposal is None or proposal["protocol"] is None:
        path.unlink(missing_ok=True)
        return None
    content = make_protocol(proposal).model_dump(mode="json", exclude_unset=True)
    settle = content.pop("settle")
    entries = "stages" if "stages" in content else "conditions"
    tables = [
        table("settle", settle),
        *(table(f"[{entries}]", entry) for entry in content.pop(entries)),
    ]
    plain = "".join(f"{name} = {format_value(value)}\n" for name, value in content.items())
    write_atomically(
        path, (toml_comment(proposal["why"]) + "\n".join([plain, *tables])).encode("utf-8")
    )
    return path


@dataclass(frozen=True)
class FeasibleRegion:
    """Limits of a proposal: lowest and highest rack, greatest speed, greatest load on the
    sensor.
    """

    lowest_m: float
    highest_m: float
    speed_rad_s: float
    load: Load

    def allows(self, load: Load) -> bool:
        """Whether force and moment are within the limits."""
        return load.max_with(self.load) == self.load

    def heights_m(self, recorded_m: Iterable[float]) -> list[float]:
        """The recorded heights, and a grid of whole 5 mm between the ends."""
        grid = (
            5e-3
            * np.linspace(
                np.ceil(self.lowest_m / 5e-3), np.floor(self.highest_m / 5e-3), GRID
            ).round()
        )
        heights = {round(float(height), 6) for height in (*grid, *recorded_m)}
        return sorted(
            h for h in heights if h > 0.0 and self.lowest_m - 1e-9 <= h <= self.highest_m + 1e-9
        )


def propose_experiment(
    prepared: PreparedLeg, findings: LegFindings, enough: bool, limits: Limits | None = None
) -> dict[str, object] | None:
    """The next experiment; None where nothing is open or nothing would help.

    Parameters
    ----------
    prepared, findings
        The recordings, and the results in the forces and in the motion of the shaft.
    enough
        Whether there are enough conditions for a decision. If not, only a further dynamic condition
        helps.
    limits
        Those of the rig. If they are not known, no higher speed and no greater load than were
        recorded are proposed.

    Returns
    -------
    dict or None
        Keys: kind, height_mm, speed_rad_s or stages, repeats, minutes, separates, why, protocol
        (None off the rig).
    """
    unsettled = [
        list_open_hypotheses(finding.search, finding.decision, enough)
        for finding in (findings.forces, findings.shaft)
        if finding is not None
    ]
    options = [
        option
        for hypotheses in unsettled
        if hypotheses
        for option in _list_options(prepared, findings, hypotheses, enough, limits)
    ]
    if options or enough:
        return propose(options)
    # Too few conditions, and no design separates hypotheses: the condition that is least like the
    # recorded ones is proposed.
    designs = list(_flap_designs(prepared, findings, _find_region(prepared, findings, limits)))
    possible = [
        (apart, design)
        for apart, design in designs
        if design.try_simulate(findings.forces.search.nothing) is not None
    ]
    _, farthest = max(possible, key=lambda pair: pair[0], default=(0.0, None))
    why = "a verdict needs more conditions; this one is least like those recorded"
    if farthest is None:
        return None
    return farthest.state(REPEATS[0], why)


def _list_options(
    prepared: PreparedLeg,
    findings: LegFindings,
    hypotheses: OpenHypotheses,
    enough: bool,
    limits: Limits | None,
) -> Iterator[Option]:
    of_shaft = findings.shaft is not None and hypotheses.found is findings.shaft.search
    region = _find_region(prepared, findings, limits)
    designs = [
        design
        for _, design in _flap_designs(
            prepared, findings, region, prepared.shafts[0] if of_shaft else None
        )
    ]
    if enough and not of_shaft:
        designs += _stage_designs(
            prepared, select_tables(findings.forces.search.dataset.parts), region
        )
    return list_options(hypotheses, designs, enough)


def _find_region(
    prepared: PreparedLeg, findings: LegFindings, limits: Limits | None
) -> FeasibleRegion:
    """The limits of the rig where they are known, otherwise the speeds and loads that were
    recorded. Raises SimulationFailed.
    """
    flaps = prepared.flaps
    tables = select_tables(findings.forces.search.dataset.parts)
    fit = findings.forces.search.nothing.fitted
    heights = [*(flap.height_m for flap in flaps), *(table.height_m for table in tables)]
    lowest_m = min(heights) - HEIGHT_BEYOND_M
    highest_m = max(heights) + HEIGHT_BEYOND_M
    fastest = max((flap.turn.speed_rad_s for flap in flaps), default=2.0 * SLOWEST_RAD_S)
    if limits is not None:
        # At greater speeds the phases of a stroke may not be found, unless such strokes were
        # recorded already.
        speed = min(LIMIT_SHARE * limits.speed_rad_s, max(fastest, READABLE_RAD_S))
        return FeasibleRegion(
            lowest_m,
            highest_m,
            speed,
            Load(LIMIT_SHARE * limits.force_N, LIMIT_SHARE * limits.torque_Nm),
        )
    in_strokes = [_load_of(flap.stroke(fit.coordinates.supposed(fit.x))) for flap in flaps]
    in_stages = [
        Load(float(np.hypot(stage.fy_N, stage.fz_N)), abs(stage.tx_Nm))
        for table in tables
        for stage in table.stages
    ]
    return FeasibleRegion(
        lowest_m, highest_m, fastest, reduce(Load.max_with, [*in_strokes, *in_stages])
    )


def _load_of(stroke: SimulatedStroke) -> Load:
    return Load(
        float(np.hypot(stroke.fy_N, stroke.fz_N).max(initial=0.0)),
        float(np.abs(stroke.tx_Nm).max(initial=0.0)),
    )


def _flap_designs(
    prepared: PreparedLeg,
    findings: LegFindings,
    region: FeasibleRegion,
    shaft: ShaftCondition | None = None,
) -> Iterator[tuple[float, ExperimentDesign]]:
    """Strokes at heights and speeds over the region, each with its distance from the nearest
    recorded condition; 1 is the least.
    """
    slowest = min(SLOWEST_RAD_S, 0.5 * region.speed_rad_s)
    speeds = sorted({round(float(v), 1) for v in np.linspace(slowest, region.speed_rad_s, GRID)})
    recorded = np.array(
        [(flap.height_m, flap.turn.speed_rad_s) for flap in prepared.flaps]
    ).reshape(-1, 2)
    if prepared.flaps:
        start_rad = prepared.flaps[0].turn.start_rad
        noise = prepared.flaps[0].sample_noise
    else:  # static stages only: each reading is a mean, so a single sample is noisier
        table = select_tables(findings.forces.search.dataset.parts)[0]
        start_rad = None
        noise = {name: std * float(np.sqrt(MEAN_OF_SAMPLES)) for name, std in table.noise.items()}
    for height_m in region.heights_m(recorded[:, 0]):
        for speed_rad_s in speeds:
            # Heights are compared by their difference, speeds by their ratio.
            distances = np.abs(
                np.array(
                    [
                        (recorded[:, 0] - height_m) / ALIKE_M,
                        np.log(recorded[:, 1] / speed_rad_s) / ALIKE_SPEED,
                    ]
                )
            )
            if 0.0 < speed_rad_s <= region.speed_rad_s and (distances.max(axis=0) >= 1.0).all():
                distance = float(np.hypot(*distances).min(initial=np.inf))
                yield (
                    distance,
                    make_stroke_design(
                        height_m,
                        speed_rad_s,
                        region,
                        start_rad,
                        noise,
                        shaft,
                        prepared.strokes_made,
                    ),
                )


def make_stroke_design(
    height_m: float,
    speed_rad_s: float,
    region: FeasibleRegion,
    start_rad: float | None,
    noise_std: Mapping[str, float],
    shaft: ShaftCondition | None = None,
    strokes_made: int | None = None,
) -> ExperimentDesign:
    """Strokes at one height and speed.

    Parameters
    ----------
    height_m, speed_rad_s
        The condition.
    region
        Limits that every simulated stroke must keep.
    start_rad
        Recorded start angle; None if it was not recorded.
    noise_std
        Noise of one sample, by signal.
    shaft
        If given, only the motion of the shaft is compared.
    strokes_made
        How many strokes the leg has made before; None where they were not counted.
    """
    settings = {
        "kind": "dynamic",
        "height_mm": round(1e3 * height_m, 3),
        "speed_rad_s": speed_rad_s,
    }
    sweep_rad = float(np.radians(DYNAMIC["sweep_deg"]))
    back_s = (2.0 * np.pi - sweep_rad) / min(
        DYNAMIC["return_speed_rad_s"], speed_rad_s
    ) + 0.5  # over the top; half a second to stop

    def simulate(at: ModelPoint) -> DynamicCondition | ShaftCondition | None:
        # The stroke is simulated finely and then cut exactly like a recording.
        turn = ShaftTurn(speed_rad_s, start_rad)
        before_s = (
            0.2 if at.rig.swing is None else min(0.2, at.rig.swing.before_s)
        )  # recordings usually begin so long before the motion
        # The ramp delays the end of the sweep by half its duration.
        t_s = np.arange(-before_s, sweep_rad / speed_rad_s + 0.5 * at.rig.drive.ramp_s, 1e-3)
        before = () if strokes_made is None else (strokes_made,)
        stroke = simulate_stroke(
            at.rig,
            height_m + at.height_offset_m,
            turn.motion(at, float(t_s[-1])),
            t_s,
            STROKE_TOLERANCE,
            before,
        )
        if not region.allows(_load_of(stroke)):
            return None
        table = Stream(t_s, {name: Column(getattr(stroke, name), "") for name in (*FORCES, SIGNAL)})
        condition = Condition(
            height_m,
            speed_rad_s,
            (Stroke(height_m, speed_rad_s, 1, {"table": table}, strokes_made),),
        )
        flap = make_dynamic_condition(condition, noise_std, turn)
        if isinstance(flap, Undetermined) or shaft is None:
            if isinstance(flap, Undetermined):
                return None
            return flap
        turned = make_shaft_condition(condition, float(flap.t_s[-1]), at.rig.drive.ramp_s)
        if turned is None:
            return None
        return replace(turned, sample_noise_rad=shaft.sample_noise_rad)

    words = f"dynamic at {settings['height_mm']:g} mm and {speed_rad_s:g} rad/s"
    each_min = (REST_S + sweep_rad / speed_rad_s + back_s) / 60.0
    return ExperimentDesign(settings, words, SET_UP_MIN, each_min, REPEATS, simulate, NEXT_PROTOCOL)


def _stage_designs(
    prepared: PreparedLeg, tables: Sequence[StageTable], region: FeasibleRegion
) -> Iterator[ExperimentDesign]:
    """Sequences of stages at a low, a middle and a high rack where no table was recorded.

    Two tables of one height would be joined into one sequence.
    """
    heights_m = region.heights_m(flap.height_m for flap in prepared.flaps)
    free = []
    for height_m in heights_m:
        if all(abs(height_m - table.height_m) >= ALIKE_M for table in tables):
            free.append(height_m)
    for kind in SEQUENCES:
        for height_m in sorted({free[0], free[len(free) // 2], free[-1]}) if free else ():
            yield make_stage_design(
                kind, height_m, region, prepared.noise_std, prepared.strokes_made
            )


def make_stage_design(
    kind: str,
    height_m: float,
    region: FeasibleRegion,
    noise_std: Mapping[str, float | None],
    strokes_made: int | None = None,
) -> ExperimentDesign:
    """A sequence of shaft angles at one height.

    Parameters
    ----------
    kind
        One of SEQUENCES.
    height_m
        Height of the shaft.
    region
        Limits that every stage must keep.
    noise_std
        Noise of one sample by signal, where it is stated.
    strokes_made
        How many strokes the leg has made before; None where they were not counted.
    """
    angles_deg = SEQUENCES[kind]
    ways = [
        "loading",
        *("unloading" if end < start else "loading" for start, end in pairwise(angles_deg)),
    ]
    stages = [
        {"angle_deg": deg, "direction": way} for deg, way in zip(angles_deg, ways, strict=True)
    ]
    settings = {"kind": kind, "height_mm": round(1e3 * height_m, 3), "stages": stages}

    def simulate(at: ModelPoint) -> StageTable | None:
        settled = replace(at.rig, swing=None)
        start_rad = at.rig.leg.start_angle_rad
        sequence = make_protocol(settings).static_stages()  # type: ignore[union-attr]
        no_limits = Limits(*[np.inf] * 13)  # the loads are compared with the region
        plan = static_plan(
            sequence,
            RigFacts(start_rad, start_rad, settled.drive.ramp_s, no_limits, Rates(1e3, 1e3)),
        )
        if not all(region.allows(load) for load in predict_loads(plan, settled).values()):
            return None  # the leg would wedge or press too hard on the way
        empty = [
            StaticStage(height_m, n, way, angle_rad, (), 0.0, 0.0, 0.0, strokes_before=strokes_made)
            for n, (angle_rad, way) in enumerate(sequence.angles_rad, 1)
        ]
        (table,) = make_stage_tables(
            empty, noise_std, StageMoves(STATIC["move_speed_rad_s"], 0.2, 1.0)
        )  # a usual ramp, and at rest
        forces = table.simulated(at).reshape(len(FORCES), -1)
        return replace(
            table,
            stages=tuple(
                replace(s, **dict(zip(FORCES, f, strict=True)))
                for s, f in zip(empty, forces.T, strict=True)
            ),
        )

    way_rad = np.radians(
        np.abs(np.diff(angles_deg)).sum() + 360.0
    )  # and on to where the shaft waits
    each_min = (
        float(way_rad / STATIC["move_speed_rad_s"] + len(stages) * (REST_S + STATIC["average_s"]))
        / 60.0
    )
    return ExperimentDesign(
        settings,
        f"{kind} at {settings['height_mm']:g} mm",
        SET_UP_MIN,
        each_min,
        (1,),
        simulate,
        NEXT_PROTOCOL,
    )

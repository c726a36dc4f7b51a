"""Rivals built by hand: a leg that lacks one thing, recorded, and the hypotheses that a test
names, each at its best point.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.repeats import group_by_condition
from rfca_rig.description.rig_file import read_rig
from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition, make_shaft_condition
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset, nuisances_of
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.diagnosis.leg.strokes import DynamicCondition, make_dynamic_condition, make_turn
from rfca_rig.diagnosis.likelihood.covariance import RepeatScatter
from rfca_rig.diagnosis.likelihood.marginal_likelihood import make_marginal_likelihood
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.result import NamedEffect
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.recording.model import Column, StaticStage, Stream, Stroke

RIG_FILE = read_rig(Path(__file__).parents[2] / "calibration" / "twin.toml")
RIG = RIG_FILE.model()
KNOWN_TO = {
    "height_mm": 0.2,
    "start_angle_deg": 0.3,
    "friction_coefficient": 0.05,
    "k0_relative": 0.03,
    "mass_relative": 0.01,
}
NOISE = {"fy_N": 0.1, "fz_N": 0.15, "tx_Nm": 0.006}
STD = {"height": 0.1, "friction": 0.008, "start_angle": 0.1}


def recorded(
    rig: RigModel,
    conditions: Sequence[tuple[float, float]],
    with_shaft: bool = True,
    encoder_rad: float = 1e-5,
) -> list[Stroke]:
    """One stroke at each (height in mm, speed), the sensor's noise in it."""
    random = np.random.default_rng(3)
    strokes = []
    for height_mm, speed_rad_s in conditions:
        t_s = np.arange(-0.1, 3.4 / speed_rad_s, 1e-3)
        found = simulate_stroke_at_speed(rig, 1e-3 * height_mm, speed_rad_s, t_s)
        noisy = {
            name: Column(getattr(found, name) + std * random.standard_normal(len(t_s)), "")
            for name, std in NOISE.items()
        }
        if with_shaft:
            noisy["shaft_angle_rad"] = Column(
                found.shaft_angle_rad + encoder_rad * random.standard_normal(len(t_s)), "rad"
            )
        strokes.append(Stroke(1e-3 * height_mm, speed_rad_s, 1, {"table": Stream(t_s, noisy)}))
    return strokes


def late(stroke: Stroke, late_s: float) -> Stroke:
    """The same, had the rig done everything that much later than it was told to."""
    return replace(
        stroke,
        streams={name: Stream(s.t_s + late_s, s.columns) for name, s in stroke.streams.items()},
    )


def flaps_of(strokes: Sequence[Stroke]) -> tuple[DynamicCondition, ...]:
    found = [
        make_dynamic_condition(condition, NOISE, make_turn(condition, False))
        for condition in group_by_condition(strokes)
    ]
    assert all(isinstance(flap, DynamicCondition) for flap in found)
    return tuple(found)  # type: ignore[arg-type]


def shafts_of(
    strokes: Sequence[Stroke], flaps: Sequence[DynamicCondition]
) -> tuple[ShaftCondition, ...]:
    """The motion of the shaft in the same conditions, up to the last sample of their forces."""
    shafts = []
    for condition, flap in zip(group_by_condition(strokes), flaps, strict=True):
        shaft = make_shaft_condition(condition, float(flap.t_s[-1]), RIG.drive.ramp_s)
        assert isinstance(shaft, ShaftCondition)
        shafts.append(shaft)
    return tuple(shafts)


def present(effect: str, **values: float) -> PresentEffect:
    return PresentEffect(effect, tuple(values.items()))


def found_among(
    parts, rivals: Sequence[str], known_to=KNOWN_TO, rig: RigModel = RIG
) -> ModelSelectionResult:
    """What a search over these effects alone would leave, "" for nothing missing, all equally
    likely before.
    """
    dataset = make_leg_dataset(parts)
    coordinates = Parameterization(nuisances_of(rig, known_to, 0.0))
    likelihood = make_marginal_likelihood(dataset.rows, np.empty((len(dataset.rows.measured), 0)))
    optimizer = GaussNewton(dataset, likelihood)
    base = optimizer.at(coordinates, np.zeros(coordinates.size))
    assert base is not None
    base = optimizer.converge(optimizer.refine(base))
    named = [_hypothesis(optimizer, base, name) for name in rivals if name]
    nothing = Hypothesis((), base, likelihood.evaluate(base.linear(dataset.rows.measured)), 0.0)
    ranked = tuple(sorted(named, key=lambda h: -h.log_joint))
    unknown = likelihood.evaluate_unknown(base.linear(dataset.rows.measured))
    return ModelSelectionResult(
        nominal=base,
        nothing=nothing,
        unknown=unknown,
        named=ranked,
        probes=(),
        coarse=likelihood,
        in_coarse=np.ones(len(dataset.rows.measured), dtype=bool),
        scatter=RepeatScatter(STD, np.empty((len(dataset.rows.measured), 0))),
        likelihood=likelihood,
        dataset=dataset,
    )


def _hypothesis(optimizer: GaussNewton, base, name: str) -> Hypothesis:
    choice = EffectTerm(catalogue()[name])
    wider = base.coordinates.with_terms((choice,))
    ends = []
    for z in (-0.8, 0.3):
        start = optimizer.at(wider, np.append(base.x, np.full(len(choice.free), z)), base.jacobian)
        if start is not None:
            ends.append(optimizer.converge(optimizer.refine(start)))
    evaluate = [
        (optimizer.likelihood.evaluate(end.linear(optimizer.dataset.rows.measured)), end)
        for end in ends
    ]
    marginal, best = max(evaluate, key=lambda pair: pair[0].log_evidence)
    return Hypothesis((name,), best, marginal, 0.0)


def named(found: ModelSelectionResult, *others: str) -> Decision:
    """The likeliest is accepted, and these cannot be told from it."""
    best = found.named[0]
    effect = NamedEffect(best.ids[0], "", 0.95, {}, tuple(others), "")
    return Decision("identified", best, None, (effect,), probability=0.95)


def undecided(found: ModelSelectionResult) -> Decision:
    return Decision("unexplained", found.nothing, found.named[0] if found.named else None)


def nothing_missing(found: ModelSelectionResult, probability: float = 0.99) -> Decision:
    return Decision("nothing missing", found.nothing, probability=probability)


def prepared_of(flaps, found: ModelSelectionResult, shafts=()) -> PreparedLeg:
    return PreparedLeg(
        title="by hand",
        rig=RIG,
        known_to=KNOWN_TO,
        noise_std=NOISE,
        flaps=tuple(flaps),
        shafts=tuple(shafts),
        tables=(),
        as_commanded=not shafts,
        coordinates=found.nothing.fitted.coordinates,
        remarks=(),
    )


def finding_of(search: ModelSelectionResult, decision: Decision) -> DecidedSearch:
    return DecidedSearch((), search, decision)


def read_at_rest(
    supposed: ModelPoint, moves: StageMoves, turned_deg: Sequence[float]
) -> list[StaticStage]:
    """Stages of a static table as this rig would be read without noise, the shaft turned to
    these angles one after the other.
    """
    ways = [
        "loading",
        *("loading" if there > here else "unloading" for here, there in pairwise(turned_deg)),
    ]
    turned = enumerate(zip(turned_deg, ways, strict=True), start=1)
    blank = [
        StaticStage(0.215, i, way, float(np.radians(deg)), (), 0.0, 0.0, 0.0)
        for i, (deg, way) in turned
    ]
    (table,) = make_stage_tables(blank, {}, moves)
    forces = table.simulated(supposed).reshape(3, -1).T
    return [
        replace(s, fy_N=float(fy), fz_N=float(fz), tx_Nm=float(tx))
        for s, (fy, fz, tx) in zip(blank, forces, strict=True)
    ]

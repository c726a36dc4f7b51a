"""Choice of the experiment that best separates the open hypotheses per minute, among all that the rig and a person can do.

    score = sum over pairs of p_k p_l min(expected log evidence, ENOUGH) / minutes

A kind of rig provides its experiments as designs. Bench tests compete with them.

References
----------
Hunter and Reiner, Technometrics 7 (1965) 307.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import AS_GOOD_LOG_ODDS
from rfca_rig.diagnosis.experiment_design.expected_information import ExpectedInformation, predict_information
from rfca_rig.diagnosis.experiment_design.open_hypotheses import OpenHypotheses
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.simulator import ConditionData
from rfca_rig.errors import BadInput, SimulationFailed

Floats = NDArray[np.float64]

ENOUGH = 10.0  # log evidence: more decides nothing further, and a bench test decides as surely
LOOKED_INTO = 6  # designs, most promising first, whose parameters are freed: each costs a simulation per parameter
AS_GOOD_AS = 0.9  # share of the best score, within which a gentler experiment is preferred
SET_UP_MIN = 2.0  # minutes of a person before an experiment: start pose, arming, a look at the rig


@dataclass(frozen=True)
class ExperimentDesign:
    """Something that can be done next.

    Parameters
    ----------
    settings
        Its "kind" and settings, as the diagnosis states them.
    words
        The same in words.
    set_up_min, each_min
        Usual minutes: once, and for each repeat.
    repeats
        Numbers of repeats to choose from, ascending.
    simulate
        Makes the condition from the simulator's input, as if recorded once without noise. It returns None where the rig may not do that, or
        where the recording could not be used. It may raise SimulationFailed and BadInput.
    protocol
        Name of the protocol file that does it; None where a person does it.
    """

    settings: Mapping[str, object]
    words: str
    set_up_min: float
    each_min: float
    repeats: tuple[int, ...] = (1,)
    simulate: Callable[[Any], ConditionData | None] = lambda _: None
    protocol: str | None = None

    def minutes(self, repeats: int) -> float:
        """Usual duration in minutes."""
        return self.set_up_min + repeats * self.each_min

    def try_simulate(self, hypothesis: Hypothesis) -> ConditionData | None:
        """The condition if the hypothesis is true; None where `simulate` returns None or fails."""
        try:
            return self.simulate(hypothesis.fitted.coordinates.supposed(hypothesis.fitted.x))
        except (SimulationFailed, BadInput):
            return None

    def state(self, repeats: int, why: str, pairs: Iterable[tuple[str, str, float]] = ()) -> dict[str, object]:
        """The design as a diagnosis proposes it."""
        minutes, separates = round(self.minutes(repeats), 1), [list(pair) for pair in pairs]
        return {**self.settings, "repeats": repeats, "minutes": minutes, "separates": separates, "why": why, "protocol": self.protocol}


# Kind, usual minutes of a person, the effects whose presence it shows whatever the rig does, and how
BENCH_TESTS = (
    ("known weight on each axis", 20.0, "sensor_gain sensor_crosstalk sensor_crosstalk_matrix sensor_saturation",
     "hang a known weight on the sensor along each axis and compare all channels"),
    ("tap test", 15.0, "sensor_lag sensor_ringing clock_offset sensor_clock_rate frame_compliance",
     "tap the sensor and its frame with the motor held, record fast: a lag rounds the tap, a clock only shifts it, a frame rings"),
    ("straightedge", 10.0, "ground_bump",
     "lay a straightedge over the plate along the way of the tip and measure the gaps with feeler gauges"),
    ("rest pose", 15.0, "gravity_tilt ground_tilt",
     "put a spirit level on rig and floor, and record the hanging leg at rest at three shaft angles"),
    ("zero before and after", 10.0, "sensor_drift", "record the sensor without load before and after a run"),
    ("gauge block", 10.0, "height_offset", "measure the shaft's height above the plate with a gauge block"),
    ("weighing", 20.0, "tip_mass heavier_link added_mass", "take the leg off and weigh it link by link"),
    ("balancing", 20.0, "centre_of_mass", "take the links off and balance each on an edge"),
    ("blocked joint", 15.0, "gear_compliance gear_compliance_of_one gear_backlash gear_backlash_of_one",
     "block each link, push both ways with its motor and read the encoder: elasticity is a slope over the torque, play a step at zero"),
    ("weight on a lever", 20.0, "torque_scale",
     "hold a known weight on a level lever with the motor and compare its moment with the recorded torque"),
    ("blocked step", 15.0, "torque_delay torque_lag", "block the link against a force gauge, step the torque and compare the two in time"),
    ("unloaded leg", 10.0, "hinge_rest_angle hinge_rest_angle_of_one",
     "take the leg off, lay it on its side on a smooth table, and read the angle of each hinge without load"),
    ("bench pull", 30.0, "stiffness_hardening damaged_hinge hinge_backlash hinge_stop",
     "clamp the leg hinge by hinge and read the angle under known weights"),
)  # fmt: skip


@dataclass(frozen=True)
class Option:
    """A design with a number of repeats, and its score.

    Parameters
    ----------
    pairs
        (hypothesis, hypothesis, expected log evidence), the pair that matters most first.
    score
        Per minute.
    load
        The largest value that would be recorded; 0 off the rig.
    """

    design: ExperimentDesign
    repeats: int
    pairs: tuple[tuple[str, str, float], ...]
    score: float
    load: float = 0.0


def list_options(hypotheses: OpenHypotheses, designs: Iterable[ExperimentDesign], with_bench_tests: bool) -> Iterator[Option]:
    """All designs and bench tests that would separate at least two of the hypotheses."""
    conditions = [(design, condition) for design in designs if (condition := design.try_simulate(hypotheses.open[0])) is not None]
    views = [(design, view) for design, condition in conditions if (view := predict_information(hypotheses, condition)) is not None]
    # A bound needs one simulation per hypothesis; the exact score needs one per parameter.
    bounds = [_worth(hypotheses, view.bound(d.repeats[-1])).sum() / d.minutes(d.repeats[0]) for d, view in views]
    tenth = 0.1 * max(bounds, default=0.0) or 1.0  # of those that promise about as much, the gentle designs come first
    best = 0.0
    for n in sorted(range(len(views)), key=lambda n: (-round(bounds[n] / tenth), views[n][1].load))[:LOOKED_INTO]:
        # Designs come in the order of their bounds, so those that follow promise about as little or less.
        if AS_GOOD_AS * bounds[n] <= best:
            break
        for option in _list_repeats(hypotheses, *views[n]):
            best = max(best, option.score)
            yield option
    for kind, minutes, effects, words in BENCH_TESTS if with_bench_tests else ():
        # A bench test separates hypotheses that differ in the effects it shows.
        shown = [set(effects.split()) & set(hypothesis.ids) for hypothesis in hypotheses.open]
        expected = ENOUGH * np.array([[one != other for other in shown] for one in shown])
        if expected.any():
            yield _make_option(hypotheses, ExperimentDesign({"kind": kind}, words, 0.0, minutes), 1, expected)


def propose(options: Sequence[Option]) -> dict[str, object] | None:
    """The gentlest of the options that are about as good as the best, with its number of repeats; None where there is no option."""
    good = AS_GOOD_AS * max((option.score for option in options), default=0.0)
    chosen = min((o for o in options if o.score >= good), key=lambda o: (o.load, -o.score), default=None)
    if chosen is None:
        return None
    one, other, expected = chosen.pairs[0]
    reason = f"it tells {one} from {other}, log evidence {expected:.0f} expected, and yields most per minute of all that was considered"
    return chosen.design.state(chosen.repeats, f"{chosen.design.words}: {reason}", chosen.pairs)


def _list_repeats(hypotheses: OpenHypotheses, design: ExperimentDesign, view: ExpectedInformation) -> Iterator[Option]:
    """An option for each number of repeats that separates a pair; none where the rig may not do it under one of the hypotheses."""
    if any(design.try_simulate(hypothesis) is None for hypothesis in hypotheses.open[1:]):
        return
    for repeats, expected in zip(design.repeats, view.expect(design.repeats) or (), strict=False):
        option = _make_option(hypotheses, design, repeats, expected, view.load)
        if any(log_evidence >= AS_GOOD_LOG_ODDS for _, _, log_evidence in option.pairs):
            yield option


def _make_option(hypotheses: OpenHypotheses, design: ExperimentDesign, repeats: int, expected: Floats, load: float = 0.0) -> Option:
    """The option with its score and the pairs that it separates: a log evidence of 1 or more, mean of both directions."""
    names = [" with ".join(hypothesis.ids) or "nothing missing" for hypothesis in hypotheses.open]
    mean, worth = 0.5 * (expected + expected.T), _worth(hypotheses, expected)
    pairs = sorted(np.argwhere(np.triu(mean >= 1.0, 1)), key=lambda pair: -worth[*pair])
    separated = tuple((names[k], names[j], round(float(mean[k, j]), 1)) for k, j in pairs)
    return Option(design, repeats, separated, float(worth.sum()) / design.minutes(repeats), load)


def _worth(hypotheses: OpenHypotheses, expected: Floats) -> Floats:
    """Contribution of each pair to the score (n, n), upper triangle, per experiment; `expected` is (n, n)."""
    p = hypotheses.probability
    return np.triu(np.outer(p, p) * np.minimum(0.5 * (expected + expected.T), ENOUGH), 1)

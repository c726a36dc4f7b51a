"""The next experiment: of all that the rig and a person can do, what best tells apart the rivals that are left, per minute.

    score = sum over pairs of p_k p_l min(expected log evidence, ENOUGH) / minutes

after Hunter and Reiner, Technometrics 7 (1965) 307. More evidence than ENOUGH decides nothing further.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.diagnosis.config import AS_GOOD
from rfca_rig.diagnosis.experiment_design.bench_tests import CERTAIN, OFF_RIG, OffRigTest
from rfca_rig.diagnosis.experiment_design.designs import SEQUENCES, Candidate, FlapCandidate, StageCandidate, flap_conditions, stage_heights
from rfca_rig.diagnosis.experiment_design.expected_information import ExpectedInformation, expected_information
from rfca_rig.diagnosis.experiment_design.feasible_region import FeasibleRegion, room_of
from rfca_rig.diagnosis.experiment_design.next_protocol import NEXT_PROTOCOL
from rfca_rig.diagnosis.experiment_design.open_hypotheses import OpenHypotheses, contest_of, name_of
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.leg.simulator import tables_of
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.protocol.plan import Limits

if TYPE_CHECKING:
    from rfca_rig.diagnosis.diagnose import Findings, PreparedData

Floats = NDArray[np.float64]

ENOUGH = 10.0
LOOKED_INTO = 6  # of the most promising candidates, rivals allowed to move
NOISE: Mapping[str, float] = {"fy_N": 0.1, "fz_N": 0.15, "tx_Nm": 0.006}  # of one sample, where nothing is known
FEWEST_REPEATS = 3
AS_GOOD_AS = 0.9  # share of the best score


@dataclass(frozen=True)
class Option:
    """Something to do, what it tells apart as (rival, rival, expected log evidence), its score, and the largest value it would show."""

    described: Mapping[str, object]
    repeats: int
    minutes: float
    pairs: tuple[tuple[str, str, float], ...]
    score: float
    load: float = 0.0
    how: str = ""


def next_experiment(body: "PreparedData", verdicts: "Findings", enough: bool, limits: Limits | None = None) -> dict[str, object] | None:
    """What to do next; None where nothing is open or nothing would help.

    Without `enough` conditions for a verdict only a further condition helps. Where the rig's `limits` are not known, it is asked for no
    higher speed and no greater load than it was recorded with. Keys: kind, height_mm, speed_rad_s or stages, repeats, minutes,
    separates, why, protocol (None off the rig).
    """
    contests = _contests(verdicts, enough)
    options = [option for contest in contests for option in _options(body, verdicts, contest, enough, limits)]
    if options:
        return proposal_of(choose_option(options))
    return None if enough else _one_more_condition(body, verdicts, limits)


def _contests(verdicts: "Findings", enough: bool) -> list[OpenHypotheses]:
    found = [(verdicts.leg, verdicts.leg_decision)]
    if verdicts.drive is not None and verdicts.drive_decision is not None:
        found.append((verdicts.drive, verdicts.drive_decision))
    return [contest for f, d in found if (contest := contest_of(f, d, enough)) is not None]


def choose_option(options: Sequence[Option]) -> Option:
    """The gentlest of those that are about as good as the best; of its numbers of repeats, the better."""
    best = max(option.score for option in options)
    return min((option for option in options if option.score >= AS_GOOD_AS * best), key=lambda option: (option.load, -option.score))


def _options(body: "PreparedData", verdicts: "Findings", contest: OpenHypotheses, enough: bool, limits: Limits | None) -> Iterator[Option]:
    """All that is worth doing about one contest."""
    if len(contest.open) < 2:
        return
    of_shaft = contest.found is verdicts.drive
    room = _room(body, verdicts, limits)
    candidates: list[Candidate] = list(_flaps(body, room, of_shaft))
    if enough and not of_shaft:
        candidates += _stages(body, verdicts, room)
    yield from on_rig_options(contest, candidates)
    if enough:
        yield from off_rig_options(contest)


def _room(body: "PreparedData", verdicts: "Findings", limits: Limits | None) -> FeasibleRegion:
    nothing = verdicts.leg.nothing.fitted
    return room_of(body.flaps, tables_of(verdicts.leg.evidence.parts), nothing.coordinates.supposed(nothing.x), limits)


def _flaps(body: "PreparedData", room: FeasibleRegion, of_shaft: bool) -> list[FlapCandidate]:
    like = body.flaps[0] if body.flaps else None
    noise = dict(NOISE) if like is None else dict(like.sample_noise)
    start_rad = None if like is None else like.turn.start_rad
    shaft = body.shafts[0] if of_shaft else None
    heights = [flap.height_m for flap in body.flaps]
    return [FlapCandidate(h, v, room, noise, start_rad, shaft) for h, v in flap_conditions(body.flaps, heights, room)]


def _stages(body: "PreparedData", verdicts: "Findings", room: FeasibleRegion) -> list[StageCandidate]:
    """At a low, a middle and a high rack."""
    free = stage_heights([table.height_m for table in tables_of(verdicts.leg.evidence.parts)], [flap.height_m for flap in body.flaps], room)
    heights = sorted({free[0], free[len(free) // 2], free[-1]}) if free else []
    return [StageCandidate(kind, height_m, room, body.noise_std) for kind in SEQUENCES for height_m in heights]


def on_rig_options(contest: OpenHypotheses, candidates: Iterable[Candidate]) -> Iterator[Option]:
    """The candidates in the order of what they could yield at most, gentle ones first, until no other can be clearly better."""
    views = [(candidate, view) for candidate in candidates if (view := _seen(contest, candidate)) is not None]
    bounds = [(_worth(contest, view.at_most(max(c.repeats)), c.minutes(min(c.repeats))), c, view) for c, view in views]
    top = max((bound for bound, _, _ in bounds), default=0.0)
    best = 0.0
    for bound, candidate, view in sorted(bounds, key=lambda entry: (-round(10.0 * entry[0] / max(top, 1e-300)), entry[2].load))[
        :LOOKED_INTO
    ]:
        if AS_GOOD_AS * bound <= best:
            return
        for option in _looked_into(contest, candidate, view):
            best = max(best, option.score)
            yield option


def _seen(contest: OpenHypotheses, candidate: Candidate) -> ExpectedInformation | None:
    try:
        part = candidate.part(_supposed(contest.open[0]))
    except (SimulationFailed, BadInput):
        return None
    return None if part is None else expected_information(contest, part)


def _looked_into(contest: OpenHypotheses, candidate: Candidate, view: ExpectedInformation) -> Iterator[Option]:
    """Each number of repeats that is worth it; none where the rig may not do it under one of the rivals."""
    if not all(_possible(candidate, _supposed(hypothesis)) for hypothesis in contest.open[1:]):
        return
    for repeats, gained in zip(candidate.repeats, view.expected(candidate.repeats) or (), strict=False):
        minutes = candidate.minutes(repeats)
        option = Option(candidate.described(), repeats, minutes, _pairs(contest, gained), _worth(contest, gained, minutes), view.load)
        if any(log_evidence >= AS_GOOD for _, _, log_evidence in option.pairs):
            yield option


def _possible(candidate: Candidate, supposed: Supposed) -> bool:
    try:
        return candidate.part(supposed) is not None
    except (SimulationFailed, BadInput):
        return False


def _supposed(hypothesis: Hypothesis) -> Supposed:
    supposed: Supposed = hypothesis.fitted.coordinates.supposed(hypothesis.fitted.x)
    return supposed


def _worth(contest: OpenHypotheses, gained: Floats, minutes: float) -> float:
    useful = np.minimum(0.5 * (gained + gained.T), ENOUGH)
    p = contest.probability
    return float(sum(p[k] * p[j] * useful[k, j] for k, j in combinations(range(len(p)), 2)) / minutes)


def _pairs(contest: OpenHypotheses, gained: Floats) -> tuple[tuple[str, str, float], ...]:
    """What is told apart at least a little, with the mean of both directions; the pair that matters most comes first."""
    names, p = [name_of(h.ids) for h in contest.open], contest.probability
    mean = 0.5 * (gained + gained.T)
    pairs = [(k, j) for k, j in combinations(range(len(names)), 2) if mean[k, j] >= 1.0]
    pairs.sort(key=lambda pair: -p[pair[0]] * p[pair[1]] * min(mean[pair], ENOUGH))
    return tuple((names[k], names[j], round(float(mean[k, j]), 1)) for k, j in pairs)


def off_rig_options(contest: OpenHypotheses) -> Iterator[Option]:
    """The bench tests that would decide something about the contest."""
    for test in OFF_RIG:
        gained = _decided_by(test, contest.open)
        if gained.any():
            score = _worth(contest, gained, test.minutes)
            yield Option({"kind": test.kind}, 1, test.minutes, _pairs(contest, gained), score, how=test.how)


def _decided_by(test: OffRigTest, hypotheses: Sequence[Hypothesis]) -> Floats:
    return np.array([[CERTAIN * test.separates(one.ids, other.ids) for other in hypotheses] for one in hypotheses])


def proposal_of(option: Option) -> dict[str, object]:
    """The option as a diagnosis states it."""
    one, other, gained = option.pairs[0]
    reason = f"it tells {one} from {other}, log evidence {gained:.0f} expected, and yields most per minute of all that was considered"
    return {
        **option.described,
        "repeats": option.repeats,
        "minutes": round(option.minutes, 1),
        "separates": [list(pair) for pair in option.pairs],
        "why": f"{option.how}: {reason}" if option.how else f"{_place(option.described)}: {reason}",
        "protocol": None if option.how else NEXT_PROTOCOL,
    }


def _place(described: Mapping[str, object]) -> str:
    speed = f" and {described['speed_rad_s']:g} rad/s" if "speed_rad_s" in described else ""
    return f"{described['kind']} at {described['height_mm']:g} mm{speed}"


def _one_more_condition(body: "PreparedData", verdicts: "Findings", limits: Limits | None) -> dict[str, object] | None:
    """The possible condition that lies farthest from all recorded ones; None where there is none."""
    possible = [c for c in _flaps(body, _room(body, verdicts, limits), False) if _possible(c, _supposed(verdicts.leg.nothing))]
    farthest = max(possible, key=lambda candidate: _distance(body, candidate), default=None)
    if farthest is None:
        return None
    return {
        **farthest.described(),
        "repeats": FEWEST_REPEATS,
        "minutes": round(farthest.minutes(FEWEST_REPEATS), 1),
        "separates": [],
        "why": "a verdict needs more conditions; this one is least like those recorded",
        "protocol": NEXT_PROTOCOL,
    }


def _distance(body: "PreparedData", candidate: FlapCandidate) -> float:
    """20 mm count as much as a speed that differs by a third."""
    apart = [
        np.hypot((candidate.height_m - f.height_m) / 0.020, np.log(candidate.speed_rad_s / f.turn.speed_rad_s) / np.log(4.0 / 3.0))
        for f in body.flaps
    ]
    return float(min(apart, default=0.0))

"""A short formula for the force at a place: at most three terms of a small library, the same for
every choice of conditions.

Terms are not fitted to the estimated force, which is smoothed and noisy, but to the rows: each term
has its response there. They are added one by one as long as the evidence grows by more than the
choice costs. This is repeated without each condition in turn. A term is used if four of five of
these fits choose it (stability selection: Meinshausen and Buehlmann, J. R. Statist. Soc. B 72
(2010) 417).

The terms are plain functions of what the motion offers, with units. The course of a term comes from
the simulated motion, which has no noise, never from a differentiated recording.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import AS_GOOD_LOG_ODDS
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening
from rfca_rig.diagnosis.residual_force.force_inputs import (
    CHANNELS,
    ForceInput,
    NominalCondition,
    try_stroke,
)
from rfca_rig.diagnosis.residual_force.force_localization import (
    ForceScene,
    NormalEquations,
    make_held_out_equations,
    make_normal_equations,
    misfit_by_channel,
)
from rfca_rig.diagnosis.residual_force.spline_force import Change
from rfca_rig.executors.parallel import map_in_processes
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

Floats = NDArray[np.float64]

STILL = 1e-3  # share of the greatest speed below which a sign fades, so that rest has none

TRIED = 0.3  # of a plausible size
MAX_TERMS = 3
SELECTED_SHARE = 0.8

# Terms of the hinges that are simulated as a law; the order is that of the parameters of `series`.
SERIES = (
    "1",
    "angle",
    "|angle|",
    "angle^3",
    "sign(rate)",
    "rate",
    "rate |rate|",
    "|angle| sign(rate)",
)
# the sign of a rate fades below, or no step of the integrator would converge
SURE_OF_SIGN_RAD_S = 0.05


@dataclass(frozen=True)
class Signals:
    """Quantities that a force can depend on over one stroke of n samples, in SI units.

    `angle_rad` and `rate_rad_s` are (n, hinges), all others (n,). `t_s` counts from the command,
    `slip_m_s` is the speed of the tip along the floor, `gap_m` its height above it, and `load_N`
    the force of the floor on all ends.
    """

    t_s: Floats
    angle_rad: Floats
    rate_rad_s: Floats
    shaft_rad: Floats
    shaft_rad_s: Floats
    load_N: Floats
    slip_m_s: Floats
    gap_m: Floats
    along_m: Floats
    torque_Nm: Floats
    channels: dict[str, Floats]


def signals_of(here: NominalCondition) -> Signals:
    """The quantities in the nominal motion."""
    stroke = here.stroke
    leg = here.supposed.rig.leg
    t_s = stroke.t_s
    q = stroke.q_rad
    length = np.array(leg.link_lengths_m)
    along = np.cos(q) @ length
    gap = (
        here.flap.height_m + here.supposed.height_offset_m - leg.link_radius_m - np.sin(q) @ length
    )
    return Signals(
        t_s=t_s,
        angle_rad=np.diff(q, axis=1),
        rate_rad_s=np.gradient(np.diff(q, axis=1), t_s, axis=0),
        shaft_rad=q[:, 0],
        shaft_rad_s=np.gradient(q[:, 0], t_s),
        load_N=stroke.normal_N.sum(axis=1),
        # The end of the last link is round and rolls, so the contact point moves by its radius per
        # angle.
        slip_m_s=np.gradient(along - leg.link_radius_m * q[:, -1], t_s),
        gap_m=np.maximum(gap, 0.0),
        along_m=along,
        torque_Nm=stroke.shaft_torque_Nm,
        channels={signal: getattr(stroke, signal) for signal in here.flap.signals},
    )


@dataclass(frozen=True)
class Term:
    """`name` as in a formula, `unit` of its value ("" for none), and `course` over one stroke,
    (n,) or (n, hinges).
    """

    name: str
    unit: str
    course: Callable[[Signals], Floats]


def _sign(x: Floats) -> Floats:
    """Smooth sign of x (n,), zero at rest."""
    return np.asarray(np.tanh(x / (STILL * np.abs(x).max() + 1e-12)))


_ALWAYS = (
    Term("1", "", lambda s: np.ones_like(s.t_s)),
    Term("t", "s", lambda s: np.maximum(s.t_s, 0.0)),
)


_HINGE = (
    Term("1", "", lambda s: np.ones_like(s.angle_rad)),
    Term("angle", "rad", lambda s: s.angle_rad),
    Term("|angle|", "rad", lambda s: np.abs(s.angle_rad)),
    Term("angle^3", "rad^3", lambda s: s.angle_rad**3),
    Term("sign(rate)", "", lambda s: _sign(s.rate_rad_s)),
    Term("rate", "rad/s", lambda s: s.rate_rad_s),
    Term("rate |rate|", "rad^2/s^2", lambda s: s.rate_rad_s * np.abs(s.rate_rad_s)),
    Term("|angle| sign(rate)", "rad", lambda s: np.abs(s.angle_rad) * _sign(s.rate_rad_s)),
    Term("angle t", "rad s", lambda s: s.angle_rad * np.maximum(s.t_s, 0.0)[:, None]),
)


_SHAFT = (
    *_ALWAYS,
    Term("sign(shaft rate)", "", lambda s: _sign(s.shaft_rad_s)),
    Term("shaft rate", "rad/s", lambda s: s.shaft_rad_s),
    Term("shaft rate |shaft rate|", "rad^2/s^2", lambda s: s.shaft_rad_s * np.abs(s.shaft_rad_s)),
    Term("shaft angle", "rad", lambda s: s.shaft_rad),
    Term("cos(shaft angle)", "", lambda s: np.cos(s.shaft_rad)),
    Term("sin(shaft angle)", "", lambda s: np.sin(s.shaft_rad)),
)


_FLOOR = (
    *_ALWAYS,
    Term("load", "N", lambda s: s.load_N),
    Term("sign(slip)", "", lambda s: _sign(s.slip_m_s)),
    Term("load sign(slip)", "N", lambda s: s.load_N * _sign(s.slip_m_s)),
    Term("slip", "m/s", lambda s: s.slip_m_s),
    Term("load slip", "N m/s", lambda s: s.load_N * s.slip_m_s),
    Term("touching", "", lambda s: (s.load_N > 0.0).astype(np.float64)),
    Term("1 / (1 + gap / 10 mm)^2", "", lambda s: 1.0 / (1.0 + s.gap_m / 0.01) ** 2),
    Term("way along the floor", "m", lambda s: s.along_m),
)


# Laws of an angle between shaft and leg. A constant one is a wrong start angle, which is a nuisance
# parameter already.
_TWIST = (
    *_ALWAYS[1:],
    Term("shaft torque", "N m", lambda s: s.torque_Nm),
    Term("sign(shaft torque)", "", lambda s: _sign(s.torque_Nm)),
    Term("shaft torque |shaft torque|", "N^2 m^2", lambda s: s.torque_Nm * np.abs(s.torque_Nm)),
    Term("shaft angle", "rad", lambda s: s.shaft_rad),
    Term("cos(shaft angle)", "", lambda s: np.cos(s.shaft_rad)),
    Term("sin(shaft angle)", "", lambda s: np.sin(s.shaft_rad)),
)


def library_of(place_id: str) -> tuple[Term, ...]:
    """The terms that make sense at a place."""
    if place_id.startswith("hinge"):
        return _HINGE
    if place_id in ("fy_N", "fz_N"):
        return (*_SHAFT, *_reading(place_id))
    if place_id == "shaft":
        return (*_SHAFT, *_reading("tx_Nm"))
    if place_id == "shaft_angle":
        return _TWIST
    return _FLOOR


def _reading(signal: str) -> tuple[Term, ...]:
    unit = {"N": "N", "Nm": "N m"}[signal.rsplit("_", 1)[1]]
    return (
        Term("reading", unit, lambda s: s.channels[signal]),
        Term(
            "reading |reading|",
            f"({unit})^2",
            lambda s: s.channels[signal] * np.abs(s.channels[signal]),
        ),
        Term("reading^3", f"({unit})^3", lambda s: s.channels[signal] ** 3),
    )


@dataclass(frozen=True)
class FoundTerm:
    """One term of the law: its `coefficient` with standard deviation, in `unit`."""

    term: str
    coefficient: float
    std: float
    unit: str


@dataclass(frozen=True)
class SparseLaw:
    """The terms of a formula; none if no formula holds.

    Parameters
    ----------
    terms
        The terms with coefficients.
    log_evidence
        Above that without a force, less the cost of choosing the terms.
    explained
        Share of the misfit of all channels that it removes.
    """

    terms: tuple[FoundTerm, ...] = ()
    log_evidence: float = -np.inf
    explained: float = 0.0


@dataclass(frozen=True)
class _Library:
    """Terms of a place.

    `responses` (m, k) are for terms of plausible rms size. `per` (k,) is the force, in the unit of
    the place, per unit of each term.
    """

    place: ForceInput
    terms: tuple[Term, ...]
    responses: Floats
    per: Floats


def sparse_laws(
    scene: ForceScene, places: Sequence[tuple[ForceInput, Sequence[Floats]]]
) -> list[SparseLaw]:
    """The law at each place, at its most probable model error.

    Parameters
    ----------
    scene
        The misfit.
    places
        Each place with its responses per bump, one (m_c, count) for each condition.
    """
    libraries = [_library(scene, place, blocks) for place, blocks in places]
    best_laws = [SparseLaw()] * len(libraries)
    for whitening in scene.whitenings:
        laws = [
            _law(scene, library, whitening, _votes(scene, library, whitening))
            for library in libraries
        ]
        # Each place is judged at the discrepancy scale that suits it best.
        best_laws = [
            max(pair, key=lambda law: law.log_evidence)
            for pair in zip(best_laws, laws, strict=True)
        ]
    return best_laws


def _library(scene: ForceScene, place: ForceInput, blocks: Sequence[Floats]) -> _Library:
    terms = library_of(place.id)
    courses = []
    for condition in scene.conditions:
        signals = signals_of(condition)
        courses.append([term.course(signals) for term in terms])
    courses_by_term = zip(*courses, strict=True)
    per = place.size / np.array([_rms(term_courses) for term_courses in courses_by_term])
    conditions = zip(scene.conditions, blocks, courses, strict=True)
    jobs = [
        (condition, place, block, *term_row)
        for condition, block, course in conditions
        for term_row in zip(terms, course, per, strict=True)
    ]
    columns = map_in_processes(lambda job: _response(*job), jobs)
    count = len(terms)
    return _Library(
        place,
        terms,
        _stack(scene, [columns[i : i + count] for i in range(0, len(columns), count)]),
        per,
    )


def _law(
    scene: ForceScene, library: _Library, whitening: DiscrepancyWhitening, votes: Floats
) -> SparseLaw:
    # The votes are sums of fractions, hence the tolerance.
    kept = [
        int(k)
        for k in np.argsort(-votes, kind="stable")[:MAX_TERMS]
        if votes[k] >= SELECTED_SHARE - 1e-9
    ]
    if not kept:
        return SparseLaw()
    system = make_normal_equations(scene, whitening, library.responses)
    root = _select_columns(len(library.terms), kept)
    x, z, covariance = system.solve(root)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    terms = tuple(
        FoundTerm(
            library.terms[k].name,
            float(z[k] * library.per[k]),
            float(std[k] * library.per[k]),
            _unit(library, k),
        )
        for k in kept
    )
    left = misfit_by_channel(scene, x, library.responses @ z)
    before = misfit_by_channel(scene, system.solve(root[:, :0])[0], 0.0 * scene.target)
    # The evidence pays for the choice among the scales, and below for the choice of each term.
    gained = system.log_evidence(root) - float(np.log(len(scene.whitenings))) - scene.without
    return SparseLaw(
        terms,
        gained - len(kept) * float(np.log(len(library.terms))),
        1.0 - sum(left.values()) / sum(before.values()),
    )


def _votes(scene: ForceScene, library: _Library, whitening: DiscrepancyWhitening) -> Floats:
    """Share of the fits without one condition that choose each term, (k,)."""
    votes = np.zeros(len(library.terms))
    for system in make_held_out_equations(scene, whitening, library.responses):
        votes[_greedy(system, len(library.terms))] += 1.0 / len(scene.conditions)
    return votes


def _stack(scene: ForceScene, responses: Sequence[Sequence[Floats]]) -> Floats:
    """Responses of the terms in every condition, each in its own rows, (m, terms)."""
    matrix = np.empty((len(scene.target), len(responses[0])))
    for number, columns in enumerate(responses):
        matrix[scene.rows.condition == number] = np.column_stack(columns)
    return matrix


def _greedy(system: NormalEquations, count: int) -> list[int]:
    chosen: list[int] = []
    best = system.log_evidence(_select_columns(count, []))
    for _ in range(MAX_TERMS):
        logs = {
            k: system.log_evidence(_select_columns(count, [*chosen, k]))
            for k in range(count)
            if k not in chosen
        }
        k = max(logs, key=lambda term: logs[term])
        # A further term must gain a clear evidence, and pay for having been chosen out of `count`.
        if logs[k] < best + AS_GOOD_LOG_ODDS + np.log(count):
            break
        chosen = [*chosen, k]
        best = logs[k]
    return chosen


def _select_columns(count: int, kept: Sequence[int]) -> Floats:
    return np.eye(count)[:, list(kept)]


def _response(
    condition: NominalCondition,
    place: ForceInput,
    block: Floats,
    term: Term,
    course: Floats,
    per: float,
) -> Floats:
    """Response (m,) of the rows of one condition to a term of this course and size.

    A law of the hinges is simulated. An addition to a channel is direct. Others are superposed from
    bumps. `course` is (n,), or (n, hinges) with one course per hinge.
    """
    if place.id.startswith("hinge") and term.name in SERIES:
        change = series_in(place, term.name, TRIED * per)
        return condition.change_to(try_stroke(condition, condition.supposed, (change,)), TRIED)
    if place.id in CHANNELS:
        return condition.rows_of({CHANNELS[place.id]: per * course})
    sizes = per * np.linalg.lstsq(condition.bumps.at(condition.flap.t_s), course, rcond=None)[0]
    if sizes.ndim == 1:
        return np.asarray(block @ sizes)
    if place.id == "hinges":
        return np.asarray(np.einsum("mki,ki->m", condition.in_hinge, sizes))
    return np.asarray(block @ sizes[:, int(place.id.removeprefix("hinge")) - 2])


def _rms(courses: Sequence[Floats]) -> float:
    return max(
        float(np.sqrt(np.mean(np.concatenate([course.ravel() for course in courses]) ** 2))), 1e-12
    )


def _unit(library: _Library, k: int) -> str:
    place = library.place
    term = library.terms[k]
    if term.unit:
        return f"{place.unit} per {term.unit}"
    return place.unit


def series(  # a law takes what its place offers, needed or not
    phi: float,
    rate: float,
    elapsed: float,  # noqa: ARG001
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,  # noqa: ARG001
    parameter: Any,
) -> tuple[float, float, float]:
    """Torque of the terms of SERIES, and its derivatives by angle and rate."""
    sign = np.tanh(rate / SURE_OF_SIGN_RAD_S)
    turn = (1.0 - sign * sign) / SURE_OF_SIGN_RAD_S
    side = 1.0 if phi >= 0.0 else -1.0
    even = (
        parameter[0] + parameter[1] * phi + parameter[2] * abs(phi) + parameter[3] * phi * phi * phi
    )
    odd = (
        parameter[4] * sign
        + parameter[5] * rate
        + parameter[6] * rate * abs(rate)
        + parameter[7] * abs(phi) * sign
    )
    # Derivatives by angle and rate, which every law of a hinge returns.
    by_angle = (
        parameter[1]
        + parameter[2] * side
        + 3.0 * parameter[3] * phi * phi
        + parameter[7] * side * sign
    )
    by_rate = (
        parameter[4] * turn
        + parameter[5]
        + 2.0 * parameter[6] * abs(rate)
        + parameter[7] * abs(phi) * turn
    )
    return even + odd, by_angle, by_rate


def series_in(place: ForceInput, term: str, coefficient: float) -> Change:
    """One term of SERIES as a law at a place in the hinges."""
    row = [float(coefficient) if name == term else 0.0 for name in SERIES]
    if place.id == "hinges":
        only = -1
    else:
        only = int(place.id.removeprefix("hinge")) - 1

    def change(setup: Setup) -> Setup:
        return with_law(setup, LawUse(HINGE, series, tuple(row), None, only))

    return change

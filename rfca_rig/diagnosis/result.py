"""The answer of a diagnosis as plain values, which the report, the JSON file and the terminal
read.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.model.parameters import PresentEffect, RigModel

Floats = NDArray[np.float64]
Verdict = Literal["nothing missing", "named", "unexplained", "not enough data"]
Grade = Literal[
    "identified", "mostly", "family", "nothing missing", "unexplained", "not enough data"
]


# Begins a remark on what a recording and its reference have in common; shown with the answer.
# How the remark begins that a search ended early.
TIME_WAS_UP = "the time was up"
SHARED_ERROR = "both recordings differ from the model by"


@dataclass(frozen=True)
class Located:
    """One place where model and recordings differ: a signal in a phase, over the conditions where
    it shows.

    Parameters
    ----------
    signal, experiment, phase, conditions
        The place.
    size, unit
        Rms difference there.
    sigmas
        The same relative to noise, scatter, model error and the uncertainty of the nominal values.
    p_value
        Probability of such a difference by chance, corrected for the number of places tested.
    """

    signal: str
    experiment: str
    phase: str
    conditions: tuple[str, ...]
    size: float
    unit: str
    sigmas: float
    p_value: float


@dataclass(frozen=True)
class MapCell:
    """One cell of the map: rms difference of one signal, phase and condition, and the same
    relative to what was expected.
    """

    signal: str
    experiment: str
    phase: str
    condition: str
    size: float
    sigmas: float


@dataclass(frozen=True)
class Value:
    """A parameter's value and standard deviation, in the unit of its name."""

    value: float
    std: float


@dataclass(frozen=True)
class Criterion:
    """One of the conditions that an identified effect must meet, with the value that was found in
    words.

    `required` is the limit in words; where `found` states it too, it is at the end of `found`.
    """

    name: str
    passed: bool
    found: str
    required: str = ""


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the model lacks. `cannot_tell_from` are effects that explain these data as
    well.

    `shape` holds the fitted shape parameters of its law: nuisance parameters, which a prediction
    needs to reproduce the fit. `plausible` are the ends of the ranges within which parameters were
    looked for, by their names in the catalogue; they depend on the rig.
    """

    id: str
    left_out: str
    probability: float
    parameters: Mapping[str, Value]
    cannot_tell_from: tuple[str, ...]
    wording: str
    shape: Mapping[str, Value] = field(default_factory=dict)
    plausible: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedFamily:
    """A family of effects: its id, `words` for what is missing, `place` where it acts, its
    probability, and the ids of its members that were tried.
    """

    id: str
    words: str
    place: str
    probability: float
    members: tuple[str, ...]


@dataclass(frozen=True)
class StatedPlace:
    """Where something unlisted acts: hinges, ground, drive, shaft or sensor, in `words`, with
    its probability.
    """

    id: str
    words: str
    probability: float


@dataclass(frozen=True)
class MovedPrior:
    """A nuisance parameter that had to move by more than two prior standard deviations.

    `prior` and `now` are values with standard deviations in `unit`; `deviations` is the distance in
    prior standard deviations.
    """

    name: str
    unit: str
    prior: Value
    now: Value
    deviations: float


@dataclass(frozen=True)
class NotSeen:
    """An effect that was looked for and not found, with its detection limit; None where no
    plausible size is excluded.
    """

    id: str
    would_have_seen: Mapping[str, float] | None


def join_not_seen(first: Sequence[NotSeen], second: Sequence[NotSeen]) -> tuple[NotSeen, ...]:
    """Each effect of two lists once, with the detection limit of the first list, or else of the
    second.
    """
    not_seen = {effect.id: effect for effect in second}
    not_seen |= {
        effect.id: effect
        for effect in first
        if effect.would_have_seen is not None or effect.id not in not_seen
    }
    return tuple(sorted(not_seen.values(), key=lambda effect: effect.id))


@dataclass(frozen=True)
class Rival:
    """One hypothesis with its probability; `ids` is empty for nothing missing, and ("unknown",) for
    something unlisted.

    `prior` is its probability before the data, None where unknown.
    """

    ids: tuple[str, ...]
    probability: float
    log_evidence: float
    model_error: float
    prior: float | None = None


@dataclass(frozen=True)
class BeforeAfter:
    """A figure under the nominal model and under the accepted one, and the floor that noise
    sets.
    """

    before: float
    after: float
    noise_floor: float | None = None


@dataclass(frozen=True)
class SignalOverlay:
    """Mean signal of one condition, or of a recording whose parts are conditions, with both models,
    all (m,).

    `starts_s` are the times where windows start from the measured state. `phase` (m,) names the
    phase of each row, (0,) where unknown. `parts` are the conditions that it shows. `floor` (m,)
    is what noise and scatter leave of the measured means, (0,) where unknown.
    """

    condition: str
    signal: str
    t_s: Floats
    measured: Floats
    before: Floats
    after: Floats
    starts_s: Floats = field(default_factory=lambda: np.empty(0))
    phase: NDArray[np.str_] = field(default_factory=lambda: np.empty(0, dtype=np.str_))
    parts: tuple[str, ...] = ()
    floor: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class ForceMinimum:
    """Time and size of the minimum of fz."""

    time_s: float
    fz_N: float


@dataclass(frozen=True)
class LeftOutValley:
    """The force minimum of a condition, as in a row of Table II: measured, and by both models."""

    measured: ForceMinimum
    before: ForceMinimum
    after: ForceMinimum

    @property
    def time_error_pct(self) -> BeforeAfter:
        """Error of the time, in percent of the measured one."""
        return BeforeAfter(
            100.0 * abs(self.before.time_s / self.measured.time_s - 1.0),
            100.0 * abs(self.after.time_s / self.measured.time_s - 1.0),
        )

    @property
    def force_error_pct(self) -> BeforeAfter:
        """Error of the force, in percent of the measured one."""
        return BeforeAfter(
            100.0 * abs(self.before.fz_N / self.measured.fz_N - 1.0),
            100.0 * abs(self.after.fz_N / self.measured.fz_N - 1.0),
        )


@dataclass(frozen=True)
class LeftOutCondition:
    """A condition that was left out, at the commanded motion of the shaft.

    Parameters
    ----------
    condition
        Its name.
    overlays
        Its signals, with the nominal model, and with the accepted one whose values come from the
        other conditions.
    valley
        Its force minimum; None where it has none in one of the three.
    """

    condition: str
    overlays: tuple[SignalOverlay, ...]
    valley: LeftOutValley | None


@dataclass(frozen=True)
class Diagnosed:
    """A recording that was diagnosed: its title, and an identity that does not depend on where
    it is stored.
    """

    title: str
    source: str
    identity: str


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer.

    Parameters
    ----------
    sentence
        The answer in words.
    grade, probability
        What is stated, and how probable it is.
    verdict
        The grade in the words of rfca-diagnosis/1, where "mostly" and "family" are "unexplained".
    family, other_families
        The family of what is stated, and those of further parts of the explanation, each as
        probable as an identified effect.
    not_stated
        Each effect of the best explanation, and of the first set of the table, that is not stated,
        and why.
    explained_share
        Share of the removable held-out misfit that the stated effects explain.
    remaining
        Where model and recordings still differ.
    support
        The numbers that the probabilities rest on.
    stated_law
        A law that was measured on request.
    believed_values, priors
        The nuisance parameters after and before the fit, with standard deviations.
    nuisance_units
        Their units, where their names do not carry them; "" for a ratio.
    nuisance_keys
        The keys of [known_to] that state their priors, of a leg.
    left_out
        Conditions that were left out, at the commanded motion, of a leg.
    settings
        What the answer rests on: model error, scatter, priors.
    """

    title: str
    verdict: Verdict
    sentence: str
    located: tuple[Located, ...]
    cells: tuple[MapCell, ...]
    effects: tuple[NamedEffect, ...]
    criteria: tuple[Criterion, ...]
    rivals: tuple[Rival, ...]
    not_seen: tuple[NotSeen, ...]
    fit: Mapping[str, BeforeAfter]
    held_out: Mapping[str, BeforeAfter]
    valley: Mapping[str, BeforeAfter]
    unexplained: tuple[str, ...]
    remarks: tuple[str, ...]
    next_experiment: Mapping[str, object] | None
    believed_values: Mapping[str, Value]
    overlays: tuple[SignalOverlay, ...]
    settings: Mapping[str, object]
    found_effects: tuple[PresentEffect, ...]
    found_rig: RigModel
    grade: Grade
    probability: float | None
    family: StatedFamily | None = None
    other_families: tuple[StatedFamily, ...] = ()
    not_stated: Mapping[str, str] = field(default_factory=dict)
    place: StatedPlace | None = None
    explained_share: float | None = None
    remaining: tuple[Located, ...] = ()
    moved_priors: tuple[MovedPrior, ...] = ()
    support: tuple[Mapping[str, object], ...] = ()
    recordings: tuple[Diagnosed, ...] = ()
    stated_law: StatedLaw | None = None
    priors: Mapping[str, Value] = field(default_factory=dict)
    nuisance_units: Mapping[str, str] = field(default_factory=dict)
    nuisance_keys: Mapping[str, str] = field(default_factory=dict)
    left_out: tuple[LeftOutCondition, ...] = ()

    @property
    def is_since_reference(self) -> bool:
        """Whether the answer is about changes since a reference."""
        return "reference" in self.settings

    @property
    def is_unfinished(self) -> bool:
        """Whether the time was up before every effect was tried."""
        return bool(self.settings.get("unfinished", False))

    @property
    def is_of_stretches(self) -> bool:
        """Whether the conditions are stretches of longer recordings."""
        return any(
            overlay.parts and overlay.parts != (overlay.condition,) for overlay in self.overlays
        )


def name_parts(text: str, of_stretches: bool) -> str:
    """A text on conditions; where these are stretches of a recording, it says so."""
    if of_stretches:
        return text.replace("conditions", "stretches").replace("condition", "stretch")
    return text


def describe_probability(probability: float) -> str:
    """A probability in percent, never shown as certain: neither 0 nor 100."""
    if probability < 0.0005:
        return "< 0.1 %"
    if probability >= 0.9995:
        return "> 99.9 %"
    digits = 0 if 0.01 <= probability < 0.99 else 1
    return f"{100.0 * probability:.{digits}f} %"

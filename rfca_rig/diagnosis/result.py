"""What a diagnosis says, as plain values: the report, the JSON file and the terminal all read this."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.model.parameters import PresentEffect, RigModel

Floats = NDArray[np.float64]
Verdict = Literal["nothing missing", "named", "unexplained", "not enough data"]
Grade = Literal["identified", "mostly", "family", "nothing missing", "unexplained", "not enough data"]


@dataclass(frozen=True)
class Located:
    """One place where model and recordings part: a signal in a phase, over the conditions where it shows.

    `size` is the rms difference there in `unit`; `sigmas` the same against noise, scatter, model error and what the nominal values'
    uncertainty can do; `p_value` is that of chance, corrected for the number of places looked at.
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
    """One cell of the map: rms difference of one signal, phase and condition, and that against what could be expected."""

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
    """One of the conditions that an identified effect must meet, and in words what was found."""

    name: str
    passed: bool
    found: str


@dataclass(frozen=True)
class NamedEffect:
    """An effect that was left out. `cannot_tell_from` are those that these data explain as well by.

    `shape` holds the fitted shape parameters of its law: nuisance parameters, which a prediction needs to reproduce the fit.
    """

    id: str
    left_out: str
    probability: float
    parameters: Mapping[str, Value]
    cannot_tell_from: tuple[str, ...]
    wording: str
    shape: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class StatedFamily:
    """A family of effects: its id, `words` for what is missing, `place` where it acts, its probability, and the ids of its members."""

    id: str
    words: str
    place: str
    probability: float
    members: tuple[str, ...]


@dataclass(frozen=True)
class StatedPlace:
    """Where something unlisted acts: hinges, ground, drive, shaft or sensor, in `words`, with its probability."""

    id: str
    words: str
    probability: float


@dataclass(frozen=True)
class MovedPrior:
    """A nuisance parameter that had to move by more than two prior standard deviations.

    `prior` and `now` are values with standard deviations in `unit`; `deviations` is the distance in prior standard deviations.
    """

    name: str
    unit: str
    prior: Value
    now: Value
    deviations: float


@dataclass(frozen=True)
class NotSeen:
    """An effect that was looked for and not found: the size that would have been seen, None where none plausible would have."""

    id: str
    would_have_seen: Mapping[str, float] | None


def join_not_seen(first: Sequence[NotSeen], second: Sequence[NotSeen]) -> tuple[NotSeen, ...]:
    """Each effect of two lists once, with the size that the first would have shown, or else the second."""
    found = {one.id: one for one in second}
    found |= {one.id: one for one in first if one.would_have_seen is not None or one.id not in found}
    return tuple(sorted(found.values(), key=lambda one: one.id))


@dataclass(frozen=True)
class Rival:
    """One hypothesis with its probability; `ids` empty for nothing missing, ("unknown",) for something unlisted."""

    ids: tuple[str, ...]
    probability: float
    log_evidence: float
    model_error: float


@dataclass(frozen=True)
class BeforeAfter:
    """A figure under the nominal model, under the accepted one, and where it cannot fall below."""

    before: float
    after: float
    noise_floor: float | None = None


@dataclass(frozen=True)
class SignalOverlay:
    """One condition's mean signal with both models beside it, all (m,); `starts_s` are where windows start from the measured state."""

    condition: str
    signal: str
    t_s: Floats
    measured: Floats
    before: Floats
    after: Floats
    starts_s: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Diagnosed:
    """A recording that the diagnosis is about: by its title, and by an identity that holds wherever it lies."""

    title: str
    source: str
    identity: str


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer. `sentence` says it in words; `settings` what it rests on (model error, scatter, priors, seeds).

    `grade` is what is stated, with `probability`; `verdict` is the same in the words of rfca-diagnosis/1, where "mostly" and "family" are
    "unexplained". `explained_share` is the share of the removable held-out misfit that the stated effects explain, `remaining` where model
    and recordings still differ, `support` the numbers that the probabilities rest on, `stated_law` a law that was measured on request.
    `believed_values` are the nuisance parameters after the fit, `priors` the same before it, with their standard deviations.
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
    place: StatedPlace | None = None
    explained_share: float | None = None
    remaining: tuple[Located, ...] = ()
    moved_priors: tuple[MovedPrior, ...] = ()
    support: tuple[Mapping[str, object], ...] = ()
    recordings: tuple[Diagnosed, ...] = ()
    stated_law: StatedLaw | None = None
    priors: Mapping[str, Value] = field(default_factory=dict)

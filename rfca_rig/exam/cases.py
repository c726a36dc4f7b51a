"""The cases of the exam: what is concealed in each, drawn from one seed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from rfca_rig.exam.designs import ONE_STROKE, PAPER_CONDITIONS, THREE_BY_THREE, ExamDesign
from rfca_rig.exam.heterogeneity import Uneven, drawn_approximate, drawn_uneven
from rfca_rig.exam.labels import MISLABELLED
from rfca_rig.exam.laws import Law, drawn_law
from rfca_rig.exam.nominal_world import OffBy, drawn_off
from rfca_rig.exam.pendulum_cases import PENDULUM_KINDS, PendulumCase, drawn_pendulum
from rfca_rig.exam.sizes import SPANS, stranger_values, values_of
from rfca_rig.exam.structured import Structured, drawn_structured
from rfca_rig.exam.unknown_faults import NAMES

NOTHING, MODEL_ERROR, SINGLE, PAIR, STRANGER, WRONG_LAW, POOR_DATA, MISLABEL, APPROXIMATE, TRIPLE = LEG_KINDS = (
    "nothing missing",
    "nothing missing, model error",
    "one effect",
    "two effects",
    "stranger",
    "right family, wrong law",
    "poor data",
    "wrong metadata",
    "approximate law",
    "three effects",
)
KINDS = (*LEG_KINDS, *PENDULUM_KINDS)

LEVELS = 5
DEFAULT_NUMBERS: Mapping[str, int] = {
    NOTHING: 60,
    MODEL_ERROR: 60,
    SINGLE: LEVELS * len(SPANS),
    PAIR: 70,
    STRANGER: 65,
    WRONG_LAW: 60,
    POOR_DATA: 30,
    MISLABEL: 30,
    APPROXIMATE: 60,
    TRIPLE: 30,
    **dict(zip(PENDULUM_KINDS, (30, 60, 20, 20), strict=True)),
}

LATEST_S = 3e-3  # an adapter, a bus and the drive's own cycle
SOFT_DRIVES = ("motor_cogging", "motor_speed_droop", "motor_torque_limit", "shaft_compliance", "shaft_play")
# the second of each cannot be told from the first by a model that has one coordinate for both
NEVER_TOGETHER = (
    *({one, other} for one, other in combinations(SOFT_DRIVES, 2)),
    {"sensor_lag", "clock_offset"},
    {"sensor_crosstalk", "sensor_crosstalk_matrix"},
)

Values = dict[str, float]


@dataclass(frozen=True)
class Case:
    """One campaign to be written. `effects` are of the catalogue, `strangers` of none; by id, with their parameters.

    `strength` is from 0, hardly visible, to 1; the drive does what it is told `late_s` late; `model_error` is the share of structured
    error; `law` says which member of its family each effect's law is; `mislabelled` names what the campaign's own file says wrongly;
    `seed` decides scatter and noise.
    """

    id: str
    kind: str
    seed: int
    design: ExamDesign
    off: OffBy
    effects: Mapping[str, Values] = field(default_factory=dict)
    strangers: Mapping[str, Values] = field(default_factory=dict)
    strength: float = 0.0
    late_s: float = 0.0
    model_error: float = 0.0
    structured: Structured | None = None
    uneven: Uneven | None = None
    law: Law | None = None
    mislabelled: str | None = None


def drawn_cases(seed: int, numbers: Mapping[str, int] = DEFAULT_NUMBERS) -> list[Case | PendulumCase]:
    """As many cases of each kind as `numbers` says, in random order so that a name tells nothing. The same seed, the same cases.

    Case i of a kind does not depend on how many there are of it or of others, but for its id.
    """
    drawn = [_drawn(kind, i, np.random.default_rng([seed, KINDS.index(kind), i])) for kind in KINDS for i in range(numbers.get(kind, 0))]
    order = np.random.default_rng(seed).permutation(len(drawn))
    return [replace(drawn[j], id=f"case-{place:04d}") for place, j in enumerate(order, start=1)]


def shared_out(total: int) -> dict[str, int]:
    """`total` cases, kinds in the proportions of the whole exam."""
    whole = sum(DEFAULT_NUMBERS.values())
    exact = {kind: total * number / whole for kind, number in DEFAULT_NUMBERS.items()}
    numbers = {kind: int(share) for kind, share in exact.items()}
    rest = sorted(KINDS, key=lambda kind: numbers[kind] - exact[kind])
    for kind in rest[: total - sum(numbers.values())]:
        numbers[kind] += 1
    return numbers


def _drawn(kind: str, i: int, random: np.random.Generator) -> Case | PendulumCase:
    if kind in PENDULUM_KINDS:
        return drawn_pendulum(kind, i, random)
    design = PAPER_CONDITIONS if random.random() < 0.2 else THREE_BY_THREE
    at_prior_means = kind == NOTHING and i % 2 == 0
    late_s = 0.0 if at_prior_means else float(random.spawn(1)[0].uniform(0.0, LATEST_S))
    off = OffBy() if at_prior_means else drawn_off(random)
    case = Case(id="", kind=kind, seed=int(random.integers(2**31)), design=design, off=off, late_s=late_s)
    if kind not in (NOTHING, POOR_DATA) and (kind == MODEL_ERROR or random.random() < 0.5):
        share = float(random.uniform(0.005, 0.02)) if kind == MODEL_ERROR else 0.005
        case = replace(case, model_error=share, structured=drawn_structured(share, random))
    filled = FILLED[kind](case, i, random)
    return replace(filled, law=drawn_law(random.spawn(1)[0])) if filled.effects else filled


def _nothing(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    return case


def _single(case: Case, i: int, random: np.random.Generator) -> Case:
    """The effects in turn, and for each of them the five levels in turn; strides, so that a few cases are a mixture too."""
    effect = tuple(SPANS)[7 * i % len(SPANS)]
    strength = ((i % len(SPANS) + i // len(SPANS)) % LEVELS + random.random()) / LEVELS
    return replace(case, effects={effect: values_of(effect, strength, random)}, strength=strength)


def _pair(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    pairs = [pair for pair in combinations(SPANS, 2) if set(pair) not in NEVER_TOGETHER]
    pair = pairs[random.integers(len(pairs))]
    strength = float(random.uniform(0.4, 1.0))
    return replace(case, effects={effect: values_of(effect, strength, random) for effect in pair}, strength=strength)


def _stranger(case: Case, i: int, random: np.random.Generator) -> Case:
    name, strength = NAMES[7 * i % len(NAMES)], float(random.uniform(0.2, 1.0))
    return replace(case, strangers={name: stranger_values(name, strength, random)}, strength=strength)


def _wrong_law(case: Case, i: int, random: np.random.Generator) -> Case:
    uneven = drawn_uneven(i, random)
    strength = float(random.uniform(0.4, 1.0))
    return replace(case, effects={uneven.effect: values_of(uneven.effect, strength, random)}, strength=strength, uneven=uneven)


def _approximate(case: Case, i: int, random: np.random.Generator) -> Case:
    uneven = drawn_approximate(i, random)
    strength = float(random.uniform(0.4, 1.0))
    return replace(case, effects={uneven.effect: values_of(uneven.effect, strength, random)}, strength=strength, uneven=uneven)


def _triple(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    strength = float(random.uniform(0.4, 1.0))
    while True:
        names = tuple(tuple(SPANS)[j] for j in random.choice(len(SPANS), 3, replace=False))
        if not any(set(pair) in NEVER_TOGETHER for pair in combinations(names, 2)):
            return replace(case, effects={name: values_of(name, strength, random) for name in names}, strength=strength)


def _poor_data(case: Case, i: int, random: np.random.Generator) -> Case:
    """One stroke. Half of them hide nothing."""
    single = replace(case, design=ONE_STROKE)
    return single if i % 2 == 0 else _single(single, int(random.integers(len(SPANS) * LEVELS)), random)


def _mislabelled(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    return replace(case, mislabelled=tuple(MISLABELLED)[i % len(MISLABELLED)])


FILLED: Mapping[str, Callable[[Case, int, np.random.Generator], Case]] = {
    NOTHING: _nothing,
    MODEL_ERROR: _nothing,
    SINGLE: _single,
    PAIR: _pair,
    STRANGER: _stranger,
    WRONG_LAW: _wrong_law,
    POOR_DATA: _poor_data,
    MISLABEL: _mislabelled,
    APPROXIMATE: _approximate,
    TRIPLE: _triple,
}

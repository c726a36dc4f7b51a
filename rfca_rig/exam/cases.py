"""The cases of the exam: the hidden effects of each, drawn from one seed, from hardly visible to
gross relative to the noise of one sample.

The ranges of sizes shift the trace of fz before the valley by about 2 to 50 times the noise of a
sample, 0.15 N, at 215 mm and 2.4 rad/s. They stay within what is plausible on a leg of 0.3 kg and
0.3 m. Strength 0 is the first value, 1 the second, geometric in between. `either_sign` draws a
sign; `around` is a nominal value to which the amount is added.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from rfca_rig.exam.hidden_laws import (
    MISLABELLED,
    NAMES,
    Law,
    LawDeviation,
    draw_approximate,
    draw_law,
    draw_uneven,
)
from rfca_rig.exam.nominal_world import (
    NominalErrors,
    StructuredError,
    draw_nominal_errors,
    draw_structured_error,
)
from rfca_rig.exam.pendulums.cases import PENDULUM_KINDS, PendulumCase, draw_pendulum
from rfca_rig.exam.simulator.world import HINGES


@dataclass(frozen=True)
class SizeRange:
    """One parameter from `faint` to `strong`. A `free` one does not follow the strength but is
    drawn between the two.
    """

    faint: float
    strong: float
    free: bool = False
    either_sign: bool = False
    around: float = 0.0

    def at(self, strength: float, random: np.random.Generator) -> float:
        """A value at strength 0 to 1."""
        share = strength
        if self.free:
            share = random.random()
        size = float(self.faint * (self.strong / self.faint) ** share)
        sign = 1.0
        if self.either_sign:
            sign = random.choice([-1.0, 1.0])
        # Four digits, so that the truth states exactly the value that was simulated.
        return float(f"{self.around + sign * size:.4g}")


SIZE_RANGES: Mapping[str, Mapping[str, SizeRange]] = {
    "hinge_coulomb_friction": {"torque_Nm": SizeRange(0.01, 0.3)},
    "hinge_viscous_damping": {"coefficient_Nm_s_per_rad": SizeRange(0.02, 0.4)},
    "hinge_backlash": {"half_gap_deg": SizeRange(0.05, 2.0)},
    "hinge_stop": {
        "angle_deg": SizeRange(24.0, 18.0),
        "stiffness_Nm_per_rad": SizeRange(10.0, 30.0),
    },
    "spring_hysteresis": {
        "strength_relative": SizeRange(0.02, 0.5),
        "saturation_deg": SizeRange(2.0, 12.0, free=True),
    },
    "spring_relaxation": {
        "strength_relative": SizeRange(0.02, 0.5),
        "time_constant_s": SizeRange(0.03, 3.0, free=True),
    },
    "damaged_hinge": {"stiffness_factor": SizeRange(0.95, 0.5)},
    "stiffness_hardening": {"k2_per_rad2": SizeRange(0.15, 2.5, either_sign=True, around=4.2)},
    "hinge_rest_angle": {"angle_deg": SizeRange(0.8, 5.0, either_sign=True)},
    "hinge_rest_angle_of_one": {"angle_deg": SizeRange(1.0, 6.0, either_sign=True)},
    "tip_mass": {"mass_g": SizeRange(3.0, 60.0)},
    "fluid_drag": {"coefficient_N_s2_per_m3": SizeRange(1.0, 30.0)},
    "ground_stribeck": {
        "rise_relative": SizeRange(0.15, 1.0),
        "speed_m_s": SizeRange(0.05, 0.6, free=True),
    },
    "ground_compliance": {"stiffness_N_per_m1p5": SizeRange(1.5e5, 8e3)},
    "ground_tilt": {"slope": SizeRange(0.002, 0.04, either_sign=True)},
    "ground_adhesion": {"force_N": SizeRange(0.5, 12.0)},
    "motor_speed_droop": {
        "kp_Nm_s_per_rad": SizeRange(45.0, 2.0),
        "ki_Nm_per_rad": SizeRange(450.0, 12.0),
    },
    "motor_speed_ripple": {
        "amplitude_relative": SizeRange(0.01, 0.2),
        "cycles_per_turn": SizeRange(2.0, 30.0, free=True),
    },
    "shaft_compliance": {"stiffness_Nm_per_rad": SizeRange(1000.0, 50.0)},
    "frame_compliance": {
        "frequency_Hz": SizeRange(30.0, 6.0),
        "moving_mass_kg": SizeRange(1.0, 8.0, free=True),
        "damping_ratio": SizeRange(0.02, 0.1, free=True),
    },
    "height_offset": {"offset_mm": SizeRange(0.5, 5.0, either_sign=True)},
    "gravity_tilt": {"angle_rad": SizeRange(0.01, 0.08, either_sign=True)},
    "sensor_lag": {"time_constant_s": SizeRange(0.001, 0.02)},
    "clock_offset": {"offset_s": SizeRange(0.001, 0.02, either_sign=True)},
    "sensor_crosstalk": {"fz_per_fy": SizeRange(0.005, 0.1, either_sign=True)},
    "sensor_drift": {"rate_N_per_s": SizeRange(0.15, 4.0, either_sign=True)},
    "sensor_gain": {"factor": SizeRange(0.005, 0.08, either_sign=True, around=1.0)},
    "hinge_quadratic_damping": {"coefficient_Nm_s2_per_rad2": SizeRange(0.01, 0.1)},
    "heavier_link": {"mass_factor": SizeRange(1.3, 3.0)},
    "ground_exponent": {"exponent": SizeRange(0.05, 0.5, either_sign=True, around=1.5)},
    "sensor_saturation": {"limit_N": SizeRange(40.0, 15.0)},
    "sensor_ringing": {
        "frequency_Hz": SizeRange(60.0, 12.0),
        "damping_ratio": SizeRange(0.03, 0.3, free=True),
    },
    "sensor_clock_rate": {"rate_relative": SizeRange(0.001, 0.02, either_sign=True)},
    "shaft_friction": {"torque_Nm": SizeRange(0.01, 0.5)},
    "shaft_play": {"half_gap_deg": SizeRange(0.3, 2.0)},
    "motor_cogging": {
        "torque_Nm": SizeRange(0.1, 2.0),
        "cycles_per_turn": SizeRange(6.0, 40.0, free=True),
    },
    "motor_torque_limit": {"limit_Nm": SizeRange(8.0, 5.0)},
    "stiffness_fading": {"loss_per_decade_relative": SizeRange(0.01, 0.15)},
    "ground_bump": {
        "height_mm": SizeRange(0.3, 4.0, either_sign=True),
        "at_mm": SizeRange(40.0, 150.0, free=True),
        "width_mm": SizeRange(10.0, 40.0, free=True),
    },
    "sensor_crosstalk_matrix": {
        "fz_per_fy": SizeRange(0.005, 0.1, either_sign=True),
        "fy_per_fz": SizeRange(0.005, 0.1, either_sign=True),
        "tx_per_fy_mm": SizeRange(0.2, 5.0, either_sign=True),
        "tx_per_fz_mm": SizeRange(0.2, 5.0, either_sign=True),
    },
}

UNKNOWN_FAULT_RANGES: Mapping[str, Mapping[str, SizeRange]] = {
    "force_cogging": {
        "force_N": SizeRange(0.4, 3.0),
        "cycles_per_turn": SizeRange(12.0, 48.0, free=True),
    },
    "hinge_asymmetry": {"share": SizeRange(0.08, 0.4, either_sign=True)},
    "floor_magnet": {"force_N": SizeRange(1.0, 8.0), "reach_mm": SizeRange(5.0, 25.0, free=True)},
    "friction_by_direction": {"backward_share": SizeRange(1.15, 2.0)},
    "sensor_curvature": {"per_N": SizeRange(0.0006, 0.005, either_sign=True)},
    "stiffness_falls_with_repeats": {"share_per_repeat": SizeRange(0.015, 0.06)},
    "sensor_play": {"half_width_N": SizeRange(0.4, 3.0)},
    "sensor_creep": {"share": SizeRange(0.02, 0.2), "time_s": SizeRange(0.2, 1.0, free=True)},
    "mains_hum": {
        "amplitude_N": SizeRange(0.3, 3.0),
        "frequency_Hz": SizeRange(50.0, 100.0, free=True),
    },
    "sensor_dead_band": {"below_N": SizeRange(1.5, 8.0)},
    "coarse_digits": {"digit_N": SizeRange(1.0, 6.0)},
    "hinge_detents": {
        "torque_Nm": SizeRange(0.08, 0.6),
        "per_turn": SizeRange(30.0, 90.0, free=True),
    },
    "tendon": {"stiffness_Nm_per_rad": SizeRange(0.1, 1.0)},
    "slick_patch": {
        "friction_factor": SizeRange(0.8, 0.3),
        "at_mm": SizeRange(40.0, 120.0, free=True),
        "width_mm": SizeRange(30.0, 80.0, free=True),
    },
    "soft_patch": {
        "stiffness_factor": SizeRange(0.7, 0.2),
        "at_mm": SizeRange(40.0, 120.0, free=True),
        "width_mm": SizeRange(30.0, 80.0, free=True),
    },
    "shaking_floor": {
        "amplitude_mm": SizeRange(0.1, 0.8),
        "frequency_Hz": SizeRange(8.0, 40.0, free=True),
    },
    "hose_at_the_shaft": {"stiffness_Nm_per_rad": SizeRange(0.02, 0.3)},
}


def sample_values(effect_id: str, strength: float, random: np.random.Generator) -> dict[str, float]:
    """Parameters of a catalogue effect at a strength from 0 to 1."""
    values = {name: span.at(strength, random) for name, span in SIZE_RANGES[effect_id].items()}
    if effect_id == "heavier_link":
        values["link"] = float(random.integers(2, HINGES + 1))
    if effect_id in ("damaged_hinge", "hinge_rest_angle_of_one"):
        # Not the last hinge: it bends too little to be distinguished.
        values["hinge"] = float(random.integers(2, HINGES + 1))
    return values


def sample_unknown_fault(
    name: str, strength: float, random: np.random.Generator
) -> dict[str, float]:
    """Parameters of an effect outside the catalogue at a strength from 0 to 1."""
    return {key: span.at(strength, random) for key, span in UNKNOWN_FAULT_RANGES[name].items()}


(
    NOTHING,
    MODEL_ERROR,
    SINGLE,
    PAIR,
    STRANGER,
    WRONG_LAW,
    POOR_DATA,
    MISLABEL,
    APPROXIMATE,
    TRIPLE,
) = LEG_KINDS = (
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
    SINGLE: LEVELS * len(SIZE_RANGES),
    PAIR: 70,
    STRANGER: 65,
    WRONG_LAW: 60,
    POOR_DATA: 30,
    MISLABEL: 30,
    APPROXIMATE: 60,
    TRIPLE: 30,
    **dict(zip(PENDULUM_KINDS, (30, 60, 20, 20), strict=True)),
}

# Largest delay of a command: an adapter, a bus and the drive's own cycle.
MAX_DELAY_S = 3e-3
SOFT_DRIVES = (
    "motor_cogging",
    "motor_speed_droop",
    "motor_torque_limit",
    "shaft_compliance",
    "shaft_play",
)
# A model that has one coordinate for both cannot distinguish the second of each pair from the
# first.
NEVER_TOGETHER = (
    *({effect, other} for effect, other in combinations(SOFT_DRIVES, 2)),
    {"sensor_lag", "clock_offset"},
    {"sensor_crosstalk", "sensor_crosstalk_matrix"},
)

Values = dict[str, float]


@dataclass(frozen=True)
class ExamDesign:
    """Conditions (height in mm, speed in rad/s), each repeated, and the heights of the static
    table; none where there is no table.
    """

    conditions: tuple[tuple[float, float], ...]
    repeats: int
    static_heights_mm: tuple[float, ...]


THREE_BY_THREE = ExamDesign(
    conditions=tuple(
        (height, speed) for height in (195.0, 215.0, 235.0) for speed in (2.0, 2.6, 3.3)
    ),
    repeats=3,
    static_heights_mm=(195.0, 215.0, 235.0),
)
PAPER_CONDITIONS = ExamDesign(
    conditions=((215.0, 2.433), (215.0, 3.249), (235.0, 2.478), (235.0, 3.276)),
    repeats=5,
    static_heights_mm=(215.0, 235.0),
)
ONE_STROKE = ExamDesign(conditions=((215.0, 2.433),), repeats=1, static_heights_mm=())


@dataclass(frozen=True)
class Case:
    """One campaign to be written.

    - `off`: the true rig's differences from its nominal values.
    - `effects`, `strangers`: hidden effects of the catalogue and outside it, by id, with their
      parameters.
    - `strength`: from 0, hardly visible, to 1.
    - `late_s`: delay of the drive after its command.
    - `model_error`: relative size of the `structured` error.
    - `law`: which member of its family each effect's law is.
    - `mislabelled`: what is wrong in the campaign's own file.
    - `seed`: decides scatter and noise.
    """

    id: str
    kind: str
    seed: int
    design: ExamDesign
    off: NominalErrors
    effects: Mapping[str, Values] = field(default_factory=dict)
    strangers: Mapping[str, Values] = field(default_factory=dict)
    strength: float = 0.0
    late_s: float = 0.0
    model_error: float = 0.0
    structured: StructuredError | None = None
    uneven: LawDeviation | None = None
    law: Law | None = None
    mislabelled: str | None = None


def draw_cases(
    seed: int, numbers: Mapping[str, int] = DEFAULT_NUMBERS
) -> list[Case | PendulumCase]:
    """Draw `numbers` of cases of each kind, in random order, so that a case's name reveals nothing.

    The same seed gives the same cases. Except for its id, case i of a kind does not depend on the
    numbers of cases.
    """
    # One generator per case, seeded by kind and number: that makes a case independent of all
    # others.
    drawn = [
        _draw(kind, i, np.random.default_rng([seed, KINDS.index(kind), i]))
        for kind in KINDS
        for i in range(numbers.get(kind, 0))
    ]
    order = np.random.default_rng(seed).permutation(len(drawn))
    return [replace(drawn[j], id=f"case-{number:04d}") for number, j in enumerate(order, start=1)]


def split_numbers(total: int) -> dict[str, int]:
    """Numbers of cases of each kind, `total` in all, in the proportions of the whole exam."""
    # Largest remainders, so that the numbers add up to the total.
    whole = sum(DEFAULT_NUMBERS.values())
    exact = {kind: total * number / whole for kind, number in DEFAULT_NUMBERS.items()}
    numbers = {kind: int(share) for kind, share in exact.items()}
    rest = sorted(KINDS, key=lambda kind: numbers[kind] - exact[kind])
    for kind in rest[: total - sum(numbers.values())]:
        numbers[kind] += 1
    return numbers


def _draw(kind: str, i: int, random: np.random.Generator) -> Case | PendulumCase:
    if kind in PENDULUM_KINDS:
        return draw_pendulum(kind, i, random)
    if random.random() < 0.2:
        design = PAPER_CONDITIONS
    else:
        design = THREE_BY_THREE
    # In half of these negative controls all nominal values are right and the drive is not late.
    at_prior_means = kind == NOTHING and i % 2 == 0
    # A spawned generator does not consume the main stream, so this draw does not shift the others.
    if at_prior_means:
        late_s = 0.0
        off = NominalErrors()
    else:
        late_s = float(random.spawn(1)[0].uniform(0.0, MAX_DELAY_S))
        off = draw_nominal_errors(random)
    case = Case(
        id="", kind=kind, seed=int(random.integers(2**31)), design=design, off=off, late_s=late_s
    )
    # Half of the other cases have a small model error too, cases of that kind a larger one.
    if kind not in (NOTHING, POOR_DATA) and (kind == MODEL_ERROR or random.random() < 0.5):
        if kind == MODEL_ERROR:
            share = float(random.uniform(0.005, 0.02))
        else:
            share = 0.005
        case = replace(case, model_error=share, structured=draw_structured_error(share, random))
    filled = FILLERS[kind](case, i, random)
    if filled.effects:
        return replace(filled, law=draw_law(random.spawn(1)[0]))
    return filled


def _fill_nothing(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    return case


def _fill_single(case: Case, i: int, random: np.random.Generator) -> Case:
    """The effects in turn, and for each of them the five levels in turn; the strides make the
    first few cases a mixture too.
    """
    effect = tuple(SIZE_RANGES)[7 * i % len(SIZE_RANGES)]
    strength = ((i % len(SIZE_RANGES) + i // len(SIZE_RANGES)) % LEVELS + random.random()) / LEVELS
    return replace(
        case, effects={effect: sample_values(effect, strength, random)}, strength=strength
    )


def _fill_pair(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    pairs = [pair for pair in combinations(SIZE_RANGES, 2) if set(pair) not in NEVER_TOGETHER]
    pair = pairs[random.integers(len(pairs))]
    strength = float(random.uniform(0.4, 1.0))
    return replace(
        case,
        effects={effect: sample_values(effect, strength, random) for effect in pair},
        strength=strength,
    )


def _fill_stranger(case: Case, i: int, random: np.random.Generator) -> Case:
    name = NAMES[7 * i % len(NAMES)]
    strength = float(random.uniform(0.2, 1.0))
    return replace(
        case, strangers={name: sample_unknown_fault(name, strength, random)}, strength=strength
    )


def _fill_wrong_law(case: Case, i: int, random: np.random.Generator) -> Case:
    uneven = draw_uneven(i, random)
    strength = float(random.uniform(0.4, 1.0))
    return replace(
        case,
        effects={uneven.effect: sample_values(uneven.effect, strength, random)},
        strength=strength,
        uneven=uneven,
    )


def _fill_approximate(case: Case, i: int, random: np.random.Generator) -> Case:
    uneven = draw_approximate(i, random)
    strength = float(random.uniform(0.4, 1.0))
    return replace(
        case,
        effects={uneven.effect: sample_values(uneven.effect, strength, random)},
        strength=strength,
        uneven=uneven,
    )


def _fill_triple(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    strength = float(random.uniform(0.4, 1.0))
    while True:
        names = tuple(
            tuple(SIZE_RANGES)[j] for j in random.choice(len(SIZE_RANGES), 3, replace=False)
        )
        if not any(set(pair) in NEVER_TOGETHER for pair in combinations(names, 2)):
            return replace(
                case,
                effects={name: sample_values(name, strength, random) for name in names},
                strength=strength,
            )


def _fill_poor_data(case: Case, i: int, random: np.random.Generator) -> Case:
    """A campaign of one stroke; half of these have no hidden effect."""
    single = replace(case, design=ONE_STROKE)
    if i % 2 == 0:
        return single
    return _fill_single(single, int(random.integers(len(SIZE_RANGES) * LEVELS)), random)


def _fill_mislabelled(case: Case, i: int, random: np.random.Generator) -> Case:  # noqa: ARG001
    return replace(case, mislabelled=tuple(MISLABELLED)[i % len(MISLABELLED)])


FILLERS: Mapping[str, Callable[[Case, int, np.random.Generator], Case]] = {
    NOTHING: _fill_nothing,
    MODEL_ERROR: _fill_nothing,
    SINGLE: _fill_single,
    PAIR: _fill_pair,
    STRANGER: _fill_stranger,
    WRONG_LAW: _fill_wrong_law,
    POOR_DATA: _fill_poor_data,
    MISLABEL: _fill_mislabelled,
    APPROXIMATE: _fill_approximate,
    TRIPLE: _fill_triple,
}

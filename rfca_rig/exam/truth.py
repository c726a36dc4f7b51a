"""The truth of a case, as it is sealed.

Visibility of a case's hidden effects in the forces, as they are and after the nominal values have
been fitted.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.cases import Case
from rfca_rig.exam.hidden_laws import MISLABELLED, REVEALED_BY_ENCODER, true_world
from rfca_rig.exam.nominal_world import (
    CONTACT_SHARE,
    DAMPING_SHARE,
    FRICTION,
    HEIGHT_MM,
    K0_SHARE,
    MASS_SHARE,
    START_DEG,
    NominalErrors,
    apply_nominal_errors,
    nominal_world,
)
from rfca_rig.exam.sampled_rig import ExamScatter, build_world
from rfca_rig.exam.simulator.experiment import Noise, sense, stroke_traces
from rfca_rig.exam.simulator.world import World

Floats = NDArray[np.float64]

# Usual model error, as a share of the force.
MODEL_ERROR = 0.01

# Limit of each nominal value's change, in its prior standard deviations.
MAX_SIGMAS = 4.0
# Step in sigmas below which the fit has converged, and step of the finite differences.
CONVERGED_SIGMAS = 0.3
DIFFERENCE_SIGMAS = 0.3
# Gauss-Newton steps.
STEPS = 4
# Number of nominal values that are fitted.
NOMINAL_VALUES = 7

FORMAT = "rfca-exam-truth/1"


def errors_from_sigmas(sigmas: Floats) -> NominalErrors:
    """Differences from the nominal values by `sigmas` (7,) prior standard deviations each."""
    return NominalErrors(
        height_mm=HEIGHT_MM * sigmas[0],
        start_angle_deg=START_DEG * sigmas[1],
        friction_coefficient=FRICTION * sigmas[2],
        k0_factor=float(np.exp(K0_SHARE * sigmas[3])),
        mass_factor=float(np.exp(MASS_SHARE * sigmas[4])),
        hinge_damping_factor=float(np.exp(DAMPING_SHARE * sigmas[5])),
        contact_stiffness_factor=float(np.exp(CONTACT_SHARE * sigmas[6])),
    )


@dataclass(frozen=True)
class EffectVisibility:
    """Root mean square change of fy, fz and tx, the largest of the three, in units of a sample's
    noise.

    - `shift`: the change itself.
    - `left`: the remaining change after the nominal values have been fitted to it within their
      priors.
    - `above`: as `left`, in units of noise and of the usual model error, MODEL_ERROR of the force.
      Effects below that cannot be identified.
    """

    shift: float
    left: float
    above: float


def measure_visibility(case: Case) -> EffectVisibility:
    """Size at the first and the last condition of the case, from the command to the valley of the
    leg without the effect.

    It is infinite where only the labels of columns or conditions are wrong: these change no force.
    """
    if case.mislabelled and true_world(nominal_world(1.0), case.mislabelled) == nominal_world(1.0):
        return EffectVisibility(np.inf, np.inf, np.inf)
    first = 0
    last = len(case.design.conditions) - 1
    conditions = [_simulate_condition(case, number) for number in sorted({first, last})]
    shift = np.concatenate([condition.shift for condition in conditions], axis=1)
    moves = np.concatenate([condition.moves for condition in conditions], axis=1)
    forces = np.concatenate([condition.forces for condition in conditions], axis=1)
    noise = np.ones_like(forces)
    both = np.hypot(1.0, MODEL_ERROR * forces)
    return EffectVisibility(
        _largest_rms(shift),
        _remainder(conditions, shift, moves, noise),
        _remainder(conditions, shift, moves, both),
    )


@dataclass(frozen=True)
class _Condition:
    """One condition, in units of a sample's noise.

    - `shift` (3, m): change by the hidden effects.
    - `moves` (3, m, p): change by one sigma of each nominal value.
    - `forces` (3, m): forces without the hidden effects.
    - `change_by`: change (3, m) as a function of the nominal values' shifts (p,) in sigmas.
    """

    shift: Floats
    moves: Floats
    forces: Floats
    change_by: Callable[[Floats], Floats]


def _simulate_condition(case: Case, number: int) -> _Condition:
    """Simulate the last repeat of a condition, in which effects that grow with the repeats are
    largest.
    """
    (height_mm, speed) = case.design.conditions[number]
    repeats = case.design.repeats
    before = (number + 1) * repeats - 1
    plain = replace(case, effects={}, strangers={}, uneven=None, mislabelled=None)
    world = build_world(plain, 1e-3 * height_mm, ExamScatter(), 1)
    base, until = _forces(world, speed, None)
    concealed, _ = _forces(
        build_world(case, 1e-3 * height_mm, ExamScatter(), repeats, strokes_before=before),
        speed,
        until,
    )

    def change_by(sigmas: Floats) -> Floats:
        return (
            _forces(apply_nominal_errors(world, errors_from_sigmas(sigmas)), speed, until)[0] - base
        )

    moves = np.stack([change_by(direction) for direction in np.eye(NOMINAL_VALUES)], axis=-1)
    return _Condition(concealed - base, moves, base, change_by)


def _remainder(
    conditions: Sequence[_Condition], shift: Floats, moves: Floats, units: Floats
) -> float:
    """Remaining shift, in these units, after a Gauss-Newton fit of the nominal values with their
    priors.

    `shift` and `units` are (3, m), `moves` (3, m, p). The Jacobian is computed again after each
    large step, because far from the prior means the model is not linear.
    """
    estimate = np.zeros(NOMINAL_VALUES)
    rest = shift
    least = np.inf
    for _ in range(STEPS):
        # Gauss-Newton steps need not descend, so the smallest value of all steps counts.
        # The identity is the prior: the unknowns are in units of their prior standard deviations.
        J = (moves / units[..., None]).reshape(-1, NOMINAL_VALUES)
        step = np.asarray(
            np.linalg.solve(
                J.T @ J + np.eye(NOMINAL_VALUES), J.T @ (rest / units).ravel() - estimate
            )
        )
        least = min(least, _largest_rms((rest - moves @ step) / units))
        if np.abs(step).max() < CONVERGED_SIGMAS:
            break
        estimate = np.clip(estimate + step, -MAX_SIGMAS, MAX_SIGMAS)
        moved_there = _change_by(conditions, estimate)
        rest = shift - moved_there
        moves = np.stack(
            [
                (_change_by(conditions, estimate + DIFFERENCE_SIGMAS * direction) - moved_there)
                / DIFFERENCE_SIGMAS
                for direction in np.eye(NOMINAL_VALUES)
            ],
            axis=-1,
        )
    return min(least, _largest_rms(rest / units))


def _change_by(conditions: Sequence[_Condition], sigmas: Floats) -> Floats:
    return np.concatenate([condition.change_by(sigmas) for condition in conditions], axis=1)


def _largest_rms(x: Floats) -> float:
    return float(np.sqrt((x**2).mean(axis=1)).max())


def _forces(world: World, speed: float, until: int | None) -> tuple[Floats, int]:
    """fy, fz and tx (3, m) in units of their noise, up to sample `until`; by default the valley."""
    # Coarser than for recordings: the size of an effect needs less accuracy than its data.
    traces = stroke_traces(world, speed, step_s=2e-4)
    noise = Noise()
    fy, fz, tx = sense(world, traces)
    first = int(np.searchsorted(traces.t_s, 0.0))
    # Not before 0.3 s, so that the start of the motion is not taken for the valley.
    if until is None:
        until = int(np.argmin(np.where(traces.t_s > 0.3, fz, 0.0)))
    return np.array([fy / noise.fy_N, fz / noise.fz_N, tx / noise.tx_Nm])[:, first:until], until


def truth_of(case: Case) -> dict[str, Any]:
    """The truth of a case as plain data.

    - `effects`: the effects that a diagnosis should identify; `strangers`: those outside the
      catalogue.
    - `also_right`: other effects that describe the same thing.
    - `silence_is_right`: "nothing missing" is right too.
    - `size`: shift of the forces by the hidden effects, in units of a sample's noise.
    - `left_of_each`: the same for each effect alone, as far as nominal values cannot explain it.
    - `above_of_each`: as `left_of_each`, in units of noise and of the usual model error.
    """
    if case.effects or case.strangers or case.mislabelled:
        size = measure_visibility(case)
    else:
        size = EffectVisibility(0.0, 0.0, 0.0)
    sizes = _sizes_alone(case, size)
    return {
        "format": FORMAT,
        "case": case.id,
        "kind": case.kind,
        "effects": {name: dict(values) for name, values in case.effects.items()},
        "strangers": {name: dict(values) for name, values in case.strangers.items()},
        "mislabelled": case.mislabelled,
        "also_right": list(MISLABELLED[case.mislabelled]) if case.mislabelled else [],
        "silence_is_right": case.mislabelled in REVEALED_BY_ENCODER,
        "strength": case.strength,
        "size": {
            "shift_over_noise": _round(size.shift),
            "left_over_noise": _round(size.left),
            "left_over_model_error": _round(size.above),
        },
        "left_of_each": {effect: _round(alone.left) for effect, alone in sizes.items()},
        "above_of_each": {effect: _round(alone.above) for effect, alone in sizes.items()},
        "believed_off_by": asdict(case.off),
        "late_s": case.late_s,
        "model_error": case.model_error,
        "structured": _as_dict(case.structured),
        "uneven": _as_dict(case.uneven),
        "law": _as_dict(case.law),
        "design": asdict(case.design),
        "seed": case.seed,
    }


def _as_dict(part: Any) -> dict[str, Any] | None:
    """The fields of a dataclass; None where the case has no such part."""
    if part is None:
        return None
    return asdict(part)


def _sizes_alone(case: Case, whole: EffectVisibility) -> dict[str, EffectVisibility]:
    """Size of each effect alone: one effect of a pair may be invisible, and then no diagnosis
    can be expected to identify it.
    """
    if len(case.effects) < 2:
        return dict.fromkeys(case.effects, whole)
    return {
        effect: measure_visibility(replace(case, effects={effect: values}))
        for effect, values in case.effects.items()
    }


def _round(size: float) -> float | None:
    # JSON has no infinity: null stands for it, see `answer.parse_truth`.
    if math.isfinite(size):
        return float(f"{size:.3g}")
    return None

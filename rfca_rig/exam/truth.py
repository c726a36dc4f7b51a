"""The truth of a case, as it is sealed."""

import math
from dataclasses import asdict, replace
from typing import Any

from rfca_rig.exam.cases import Case
from rfca_rig.exam.labels import MISLABELLED, REVEALED_BY_ENCODER
from rfca_rig.exam.visible import EffectVisibility, measure_visibility

FORMAT = "rfca-exam-truth/1"


def truth_of(case: Case) -> dict[str, Any]:
    """The truth of a case as plain data.

    - `effects`: the effects that a diagnosis should identify; `strangers`: those outside the catalogue.
    - `also_right`: other effects that describe the same thing.
    - `silence_is_right`: "nothing missing" is right too.
    - `size`: shift of the forces by the hidden effects, in units of a sample's noise.
    - `left_of_each`: the same for each effect alone, as far as nominal values cannot explain it.
    - `above_of_each`: as `left_of_each`, in units of noise and of the usual model error.
    """
    size = measure_visibility(case) if case.effects or case.strangers or case.mislabelled else EffectVisibility(0.0, 0.0, 0.0)
    each = _sizes_alone(case, size)
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
        "left_of_each": {effect: _round(alone.left) for effect, alone in each.items()},
        "above_of_each": {effect: _round(alone.above) for effect, alone in each.items()},
        "believed_off_by": asdict(case.off),
        "late_s": case.late_s,
        "model_error": case.model_error,
        "structured": asdict(case.structured) if case.structured else None,
        "uneven": asdict(case.uneven) if case.uneven else None,
        "law": asdict(case.law) if case.law else None,
        "design": asdict(case.design),
        "seed": case.seed,
    }


def _sizes_alone(case: Case, whole: EffectVisibility) -> dict[str, EffectVisibility]:
    """Size of each effect alone: one effect of a pair may be invisible, and then no diagnosis can be expected to identify it."""
    if len(case.effects) < 2:
        return dict.fromkeys(case.effects, whole)
    return {effect: measure_visibility(replace(case, effects={effect: values})) for effect, values in case.effects.items()}


def _round(size: float) -> float | None:
    # JSON has no infinity: null stands for it, see `outcome.parse_truth`.
    return float(f"{size:.3g}") if math.isfinite(size) else None

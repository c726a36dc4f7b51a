"""What is written under seal about a case."""

import math
from dataclasses import asdict, replace
from typing import Any

from rfca_rig.exam.cases import Case
from rfca_rig.exam.labels import MISLABELLED, TOLD_BY_ENCODER
from rfca_rig.exam.visible import Size, size_of

FORMAT = "rfca-exam-truth/1"


def truth_of(case: Case) -> dict[str, Any]:
    """The truth of a case as plain data.

    `effects` holds what a diagnosis should name, `strangers` what it cannot; `also_right` are names that say the same; with
    `silence_is_right` "nothing missing" is right too. `size` tells how far the concealed physics shifts the forces, in units of
    a sample's noise; `left_of_each` the same for each effect alone, as far as nominal values cannot explain it; `above_of_each` in units
    of noise and of the usual model error.
    """
    size = size_of(case) if case.effects or case.strangers or case.mislabelled else Size(0.0, 0.0, 0.0)
    each = _alone(case, size)
    return {
        "format": FORMAT,
        "case": case.id,
        "kind": case.kind,
        "effects": {name: dict(values) for name, values in case.effects.items()},
        "strangers": {name: dict(values) for name, values in case.strangers.items()},
        "mislabelled": case.mislabelled,
        "also_right": list(MISLABELLED[case.mislabelled]) if case.mislabelled else [],
        "silence_is_right": case.mislabelled in TOLD_BY_ENCODER,
        "strength": case.strength,
        "size": {
            "shift_over_noise": _rounded(size.shift),
            "left_over_noise": _rounded(size.left),
            "left_over_model_error": _rounded(size.above),
        },
        "left_of_each": {effect: _rounded(alone.left) for effect, alone in each.items()},
        "above_of_each": {effect: _rounded(alone.above) for effect, alone in each.items()},
        "believed_off_by": asdict(case.off),
        "late_s": case.late_s,
        "model_error": case.model_error,
        "structured": asdict(case.structured) if case.structured else None,
        "uneven": asdict(case.uneven) if case.uneven else None,
        "law": asdict(case.law) if case.law else None,
        "design": asdict(case.design),
        "seed": case.seed,
    }


def _alone(case: Case, whole: Size) -> dict[str, Size]:
    """An effect in a pair may be invisible; then nobody can be asked to name it."""
    if len(case.effects) < 2:
        return dict.fromkeys(case.effects, whole)
    return {effect: size_of(replace(case, effects={effect: values})) for effect, values in case.effects.items()}


def _rounded(size: float) -> float | None:
    return float(f"{size:.3g}") if math.isfinite(size) else None

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
    a sample's noise; `left_of_each` the same for each effect alone, as far as believed values cannot explain it.
    """
    size = size_of(case) if case.effects or case.strangers or case.mislabelled else Size(0.0, 0.0)
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
        "size": {"shift_over_noise": _rounded(size.shift), "left_over_noise": _rounded(size.left)},
        "left_of_each": _left_of_each(case, size),
        "believed_off_by": asdict(case.off),
        "model_error": case.model_error,
        "structured": asdict(case.structured) if case.structured else None,
        "uneven": asdict(case.uneven) if case.uneven else None,
        "design": asdict(case.design),
        "seed": case.seed,
    }


def _left_of_each(case: Case, whole: Size) -> dict[str, float | None]:
    """An effect in a pair may be invisible; then nobody can be asked to name it."""
    if len(case.effects) < 2:
        return {effect: _rounded(whole.left) for effect in case.effects}
    alone = {effect: replace(case, effects={effect: values}) for effect, values in case.effects.items()}
    return {effect: _rounded(size_of(each).left) for effect, each in alone.items()}


def _rounded(size: float) -> float | None:
    return float(f"{size:.3g}") if math.isfinite(size) else None

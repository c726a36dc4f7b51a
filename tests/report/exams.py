"""Exams with made-up answers: the truths as drawn, sealed in a folder, and diagnoses of a given
honesty beside them.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from rfca_rig.exam.cases import NEVER_TOGETHER, SIZE_RANGES, Case, draw_cases
from rfca_rig.exam.hidden_laws import MISLABELLED, REVEALED_BY_ENCODER
from rfca_rig.exam.pendulums.cases import PendulumCase
from rfca_rig.exam.sealing import ExamPlan, begin, seal_all
from rfca_rig.exam.truth import FORMAT


def made_up_exam(folder: Path, numbers: Mapping[str, int], false_names: float) -> Path:
    """An exam's folder without campaigns; a share `false_names` of the answers names something
    that is not there.
    """
    begin(folder, ExamPlan(3, numbers))
    cases = draw_cases(3, numbers)
    seal_all([truth_of(case) for case in cases], folder)
    random = np.random.default_rng(3)
    for case in cases:
        into = folder / "diagnoses" / case.id
        into.mkdir(parents=True)
        (into / "diagnosis.json").write_text(json.dumps(answer_to(case, false_names, random)))
        (into / "seconds.txt").write_text(f"{random.uniform(20.0, 200.0):.1f}\n")
    return folder


def truth_of(case: Case | PendulumCase) -> dict:
    """As the exam writes it; sizes grow with the strength instead of being computed."""
    mislabelled, structured, uneven = (
        getattr(case, name, None) for name in ("mislabelled", "structured", "uneven")
    )
    if case.effects or case.strangers or mislabelled:
        left = 50.0 * case.strength**2
    else:
        left = 0.0
    return {
        "format": FORMAT,
        "case": case.id,
        "kind": case.kind,
        "effects": {name: dict(values) for name, values in case.effects.items()},
        "strangers": {name: dict(values) for name, values in case.strangers.items()},
        "mislabelled": mislabelled,
        "also_right": list(MISLABELLED[mislabelled]) if mislabelled else [],
        "silence_is_right": mislabelled in REVEALED_BY_ENCODER,
        "strength": case.strength,
        "size": {"shift_over_noise": left, "left_over_noise": left},
        "left_of_each": dict.fromkeys(case.effects, left),
        "structured": asdict(structured) if structured else None,
        "uneven": asdict(uneven) if uneven else None,
        "design": asdict(case.design)
        if isinstance(case, Case)
        else {"conditions": ["run 1", "run 2"]},
    }


def answer_to(case: Case | PendulumCase, false_names: float, random: np.random.Generator) -> dict:
    """True names at good strength; one of two that look alike is told with the other."""
    if random.random() < false_names:
        return diagnosis("named", [claim(str(random.choice(list(SIZE_RANGES))), {}, random)])
    if (
        case.strangers
        or getattr(case, "mislabelled", None)
        or (getattr(case, "uneven", None) and random.random() < 0.5)
    ):
        return diagnosis("unexplained", [])
    if not case.effects or case.strength < 0.3 * random.random():
        return diagnosis("nothing missing", [])
    return diagnosis(
        "named", [claim(name, values, random) for name, values in case.effects.items()]
    )


def claim(name: str, values: Mapping[str, float], random: np.random.Generator) -> dict:
    alike = [other for pair in NEVER_TOGETHER if name in pair for other in pair - {name}]
    if alike and random.random() < 0.4:
        told = alike[0]
        others = [name]
    else:
        told = name
        others = alike
    found = {
        key: {"value": value * (1.0 + 0.03 * random.normal()), "std": 0.03 * abs(value)}
        for key, value in values.items()
    }
    return {
        "id": told,
        "probability": float(random.uniform(0.8, 1.0)),
        "parameters": found,
        "cannot_tell_from": others,
    }


def diagnosis(verdict: str, effects: list) -> dict:
    if effects:
        fit = {"held_out_rms_fz_N": {"before": 3.0, "after": 0.45, "noise_floor": 0.2}}
    else:
        fit = None
    return {"format": "rfca-diagnosis/1", "verdict": verdict, "effects": effects, "fit": fit}

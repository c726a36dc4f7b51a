"""diagnosis.json, the diagnosis for other programs, in format rfca-diagnosis/2, which keeps
every key of version 1.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from typing import Any

import numpy as np

from rfca_rig.diagnosis.residual_force.law import StatedLaw
from rfca_rig.diagnosis.result import (
    BeforeAfter,
    Diagnosis,
    LeftOutCondition,
    Located,
    MapCell,
    NamedEffect,
    Value,
)
from rfca_rig.reports.diagnosis.left_out import measure_misfits
from rfca_rig.reports.diagnosis.tables import all_misfits

FORMAT = "rfca-diagnosis/2"
# More than a diagnosis knows, and few enough that rounding errors of different machines do not
# show.
DIGITS = 7


def as_json(diagnosis: Diagnosis) -> str:
    """The JSON document; unknown values are null."""
    return (
        json.dumps(
            to_json_types(document(diagnosis)), indent=1, ensure_ascii=False, allow_nan=False
        )
        + "\n"
    )


def document(diagnosis: Diagnosis) -> dict[str, Any]:
    """Content of diagnosis.json: first the keys that the format requires, then additional ones."""
    # Misfits before and after: signals with their noise floor, errors of the valley, which have
    # none, without.
    forces = {**all_misfits(diagnosis), **diagnosis.held_out}
    floored = {
        name: _before_after(misfit) | {"noise_floor": misfit.noise_floor}
        for name, misfit in forces.items()
    }
    return {
        "format": FORMAT,
        "verdict": diagnosis.verdict,
        "located": [_place_record(place) for place in diagnosis.located],
        "effects": [_effect(effect) for effect in diagnosis.effects],
        "not_seen": [
            {"id": effect.id, "would_have_seen": effect.would_have_seen}
            for effect in diagnosis.not_seen
            if effect.would_have_seen is not None
        ],
        "fit": floored | {name: _before_after(misfit) for name, misfit in diagnosis.valley.items()},
        "unexplained": diagnosis.unexplained,
        "next_experiment": diagnosis.next_experiment,
        "left_out": [_left_out(condition) for condition in diagnosis.left_out],
        "grade": diagnosis.grade,
        "statement": {
            "probability": diagnosis.probability,
            "explained_share": diagnosis.explained_share,
        },
        "family": _as_dict(diagnosis.family),
        "other_families": [asdict(family) for family in diagnosis.other_families],
        "not_stated": dict(diagnosis.not_stated),
        "place": _as_dict(diagnosis.place),
        "not_tested": [
            effect.id for effect in diagnosis.not_seen if effect.would_have_seen is None
        ],
        "title": diagnosis.title,
        "recordings": [asdict(recording) for recording in diagnosis.recordings],
        "sentence": diagnosis.sentence,
        "gates": [asdict(criterion) for criterion in diagnosis.criteria],
        "rivals": [
            {
                "ids": r.ids,
                "probability": r.probability,
                "log_evidence": r.log_evidence,
                "model_error": r.model_error,
                "prior": r.prior,
            }
            for r in diagnosis.rivals
        ],
        "believed_values": {
            name: _value(value) for name, value in diagnosis.believed_values.items()
        },
        "priors": {name: _prior(name, diagnosis) for name in diagnosis.priors},
        "remaining": [_place_record(place) for place in diagnosis.remaining],
        "moved_priors": [asdict(moved_prior) for moved_prior in diagnosis.moved_priors],
        "remarks": diagnosis.remarks,
        "settings": diagnosis.settings,
        "support": diagnosis.support,
        "measured_law": _law(diagnosis.stated_law),
        "cells": [_cell(cell) for cell in diagnosis.cells],
    }


def _left_out(condition: LeftOutCondition) -> dict[str, Any]:
    """Misfits by signal of a condition that was left out, and its valley."""
    misfits = {
        f"rms_{signal}": _before_after(misfit) | {"noise_floor": misfit.noise_floor}
        for signal, misfit in measure_misfits([condition]).items()
    }
    return {
        "condition": condition.condition,
        **misfits,
        "valley": _as_dict(condition.valley),
    }


def _as_dict(part: Any) -> dict[str, Any] | None:
    """The fields of a dataclass; None where the diagnosis has no such part."""
    if part is None:
        return None
    return asdict(part)


def _law(stated: StatedLaw | None) -> dict[str, Any] | None:
    if stated is None:
        return None
    law = stated.law
    has_memory = None
    if law.memory is not None:
        has_memory = law.memory.has_memory
    catalogue = None
    curve = stated.curve
    if curve is not None:
        catalogue = {"id": curve.name, "argument": curve.argument, "values": curve.values}
    return {
        "place": law.place,
        "argument": law.argument,
        "argument_unit": law.argument_unit,
        "unit": law.unit,
        "knots": law.knots,
        "values": law.values,
        "std": law.std,
        "visited": law.visited,
        "beside": law.base,
        "instead_of": stated.instead_of,
        "explained_share": law.explained,
        "has_memory": has_memory,
        "catalogue": catalogue,
    }


def to_json_types(value: object) -> Any:
    """A value in JSON's own types: arrays (m, ...) as nested lists, numbers with seven digits,
    NaN and infinity as null.
    """
    if isinstance(value, Mapping):
        return {str(name): to_json_types(item) for name, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [to_json_types(item) for item in value]
    if isinstance(value, np.generic):
        return to_json_types(value.item())
    if isinstance(value, float):
        # Adding 0.0 turns -0.0 into 0.0.
        if isfinite(value):
            return float(f"{value:.{DIGITS}g}") + 0.0
        return None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def _place_record(place: Located) -> dict[str, Any]:
    return {
        "signal": place.signal,
        "experiment": place.experiment,
        "phase": place.phase,
        "conditions": place.conditions,
        "size": place.size,
        "unit": place.unit,
        "p_value": place.p_value,
        "sigmas": place.sigmas,
    }


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "id": effect.id,
        "probability": effect.probability,
        "parameters": {name: _value(value) for name, value in effect.parameters.items()},
        "cannot_tell_from": effect.cannot_tell_from,
        "left_out": effect.left_out,
        "wording": effect.wording,
        "shape": {name: _value(value) for name, value in effect.shape.items()},
    }


def _prior(name: str, diagnosis: Diagnosis) -> dict[str, Any]:
    """The prior of a nuisance parameter, with its unit and the key of [known_to] that states it;
    the name may carry both.
    """
    facts = {
        "unit": diagnosis.nuisance_units.get(name),
        "known_to": diagnosis.nuisance_keys.get(name),
    }
    return _value(diagnosis.priors[name]) | {key: fact for key, fact in facts.items() if fact}


def _value(value: Value) -> dict[str, float]:
    return {"value": value.value, "std": value.std}


def _before_after(misfit: BeforeAfter) -> dict[str, float | None]:
    return {"before": misfit.before, "after": misfit.after}


def _cell(cell: MapCell) -> dict[str, Any]:
    return {
        "signal": cell.signal,
        "experiment": cell.experiment,
        "phase": cell.phase,
        "condition": cell.condition,
        "size": cell.size,
        "sigmas": cell.sigmas,
    }

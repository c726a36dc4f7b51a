"""The recovered hinges as a model file, which every command takes with --model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.analysis.fitting.model_file import fitted_sections
from rfca_rig.analysis.torque_rotation.remarks import remarks
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.description.model_file import write_model


def can_be_written(result: StaticResult) -> bool:
    """A model file holds springs that harden."""
    return result.values.k0_Nm_per_rad > 0.0 and result.values.k2_per_rad2 > 0.0


def write_calibration(
    path: Path, result: StaticResult, believed: Mapping[str, Any], known_to: Mapping[str, Any], sources: Sequence[str]
) -> None:
    """The believed model with the recovered k0 and k2, and how well they are known now; all or nothing.

    Where the law does not hold they are known no better than it departs from the measured curve. Raises RigError where the disk refuses.
    """
    values = result.values
    leg = replace(result.rig.leg, k0_Nm_per_rad=values.k0_Nm_per_rad, k2_per_rad2=values.k2_per_rad2)
    sections = fitted_sections(believed, replace(result.rig, leg=leg))
    known = {key: float(value) for key, value in known_to.items() if value is not None}
    write_model(path, sections, known | _known_to(result), _comments(result, sources))


def _known_to(result: StaticResult) -> dict[str, float]:
    known = result.values.known_to
    apart = 0.0 if result.form.holds else abs(result.form.apart_relative)
    return {name: float(np.hypot(std, apart)) for name, std in known.items()}


def _comments(result: StaticResult, sources: Sequence[str]) -> list[str]:
    values = result.values
    low, high = (abs(np.degrees(angle)) for angle in sorted(result.curve.range_rad, key=abs))
    return [
        *(f"Torque over rotation of the hinges, from the static stages of {source}" for source in sources),
        f"k0 {values.k0_Nm_per_rad:.4f} +- {values.reach * values.k0_std:.4f} N m/rad, k2 {values.k2_per_rad2:.4f} +- "
        f"{values.reach * values.k2_std:.4f} 1/rad2 (95 %), "
        f"errors correlated by {values.correlation:+.2f}; from {low:.1f} to {high:.1f} degrees",
        *remarks(result),
    ]

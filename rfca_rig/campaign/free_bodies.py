"""Recorded poses of free bodies as positions of the six joints that stand in for a free joint."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rfca_rig.campaign.layout import ExperimentFile, FreeSection, SignalSection
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.free_joints import (
    ANGLES,
    MAX_MIDDLE_ANGLE_RAD,
    POSITIONS,
    FreeFrame,
    choose_frame,
)
from rfca_rig.toml import place_of

if TYPE_CHECKING:
    from rfca_rig.campaign.experiment import MechanismRun

Floats = NDArray[np.float64]

POSE = 7  # columns of a pose: three of the position and four of the orientation
# A unit quaternion that was written with two digits is as far from 1.
MOST_LENGTH_ERROR = 0.05


def list_free_columns(free: FreeSection) -> dict[str, str]:
    """Content of each column of a pose, in words, by the column's name."""
    holds = {}
    for name, column in zip(POSITIONS, free.position, strict=True):
        holds[column] = f"{name} of {free.joint}"
    for name, column in zip("wxyz", free.orientation, strict=True):
        holds[column] = f"the orientation of {free.joint}, {name}"
    return holds


def list_free_signals(described: ExperimentFile) -> tuple[SignalSection, ...]:
    """The signals of all free bodies, as if their joints had been recorded."""
    signals = []
    for free in described.free:
        noise_m = None
        if free.position_noise_std is not None:
            noise_m = free.factor * free.position_noise_std
        for name in POSITIONS:
            signals.append(_make_signal(f"{free.joint}.{name}", "m", noise_m))
        for name in ANGLES:
            signals.append(_make_signal(f"{free.joint}.{name}", "rad", free.angle_noise_std_rad))
    return tuple(signals)


def _make_signal(joint: str, unit: str, noise_std: float | None) -> SignalSection:
    return SignalSection(
        joint=joint, quantity="position", column=joint, unit=unit, noise_std=noise_std
    )


def convert_poses(
    path: Path, described: ExperimentFile, runs: Sequence["MechanismRun"]
) -> tuple[tuple[FreeFrame, ...], tuple["MechanismRun", ...]]:
    """The frames of all free joints, and the recordings with the positions of their six joints.

    Samples in which the middle angle of a body is beyond MAX_MIDDLE_ANGLE_RAD are left out.

    Parameters
    ----------
    path
        Of experiment.toml, for messages.
    described
        What the columns are.
    runs
        The recordings, whose last signals are the poses, POSE columns each.

    Raises
    ------
    BadInput
        Where an orientation is no unit quaternion.
    """
    first = len(described.signals)
    frames = []
    if not described.free:
        return (), tuple(runs)
    converted = [run.signals[:, :first] for run in runs]
    factors = [np.ones((len(run.t_s), first)) for run in runs]
    is_kept = [np.ones(len(run.t_s), dtype=bool) for run in runs]
    for index, free in enumerate(described.free):
        begin = first + POSE * index
        poses = [run.signals[:, begin : begin + POSE] for run in runs]
        rotations = [_read_rotations(path, index, pose[:, 3:]) for pose in poses]
        frame = choose_frame(free.joint, rotations)
        frames.append(frame)
        for number, pose in enumerate(poses):
            angles = frame.read_angles(rotations[number])
            converted[number] = np.column_stack(
                [converted[number], free.factor * pose[:, :3], angles]
            )
            is_kept[number] &= np.abs(angles[:, 1]) <= MAX_MIDDLE_ANGLE_RAD
            # An error of the orientation turns the first and the last angle by so much more.
            amplified = np.ones((len(angles), 6))
            amplified[:, [3, 5]] = 1.0 / np.cos(angles[:, 1:2])
            factors[number] = np.column_stack([factors[number], amplified])
    usable = []
    for run, signals, noise_factors, kept in zip(runs, converted, factors, is_kept, strict=True):
        whole = replace(run, signals=signals, noise_factors=noise_factors)
        usable.append(whole.take(kept))
    return tuple(frames), tuple(usable)


def _read_rotations(path: Path, index: int, quaternions: Floats) -> Rotation:
    lengths = np.linalg.norm(quaternions, axis=1)
    off = np.abs(lengths - 1.0)
    if not off.max() <= MOST_LENGTH_ERROR:
        worst = float(lengths[int(np.argmax(off))])
        raise BadInput(
            f"{place_of(path, ('free', index, 'orientation'))}: free[{index + 1}].orientation: a "
            f"quaternion has the length {worst:.3g}, where 1 is needed; give its columns in the "
            "order w, x, y, z"
        )
    return Rotation.from_quat(quaternions[:, [1, 2, 3, 0]])

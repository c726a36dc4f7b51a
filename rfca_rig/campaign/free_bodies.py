"""Recorded poses of free bodies as positions of the six joints that stand in for a free joint."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

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


@dataclass(frozen=True)
class ConvertedSignals:
    """The signals of one recording with m samples, those of free bodies at the end.

    Parameters
    ----------
    values
        (m, s) in SI units.
    noise_factors
        (m, s) noise of each sample over the least one of its signal.
    is_usable
        (m,) whether no middle angle is beyond MAX_MIDDLE_ANGLE_RAD.
    """

    values: Floats
    noise_factors: Floats
    is_usable: NDArray[np.bool_]


def convert_poses(
    path: Path, described: ExperimentFile, recorded: Sequence[Floats]
) -> tuple[tuple[FreeFrame, ...], list[ConvertedSignals]]:
    """The frames of all free joints, and the recordings with the positions of their six joints.

    Parameters
    ----------
    path
        Of experiment.toml, for messages.
    described
        What the columns are.
    recorded
        For each recording its signals (m, c), the last of which are the poses, POSE columns each.

    Raises
    ------
    BadInput
        Where an orientation is no unit quaternion.
    """
    first = len(described.signals)
    frames = []
    converted = [
        ConvertedSignals(
            signals[:, :first], np.ones((len(signals), first)), np.ones(len(signals), dtype=bool)
        )
        for signals in recorded
    ]
    for index, free in enumerate(described.free):
        begin = first + POSE * index
        poses = [signals[:, begin : begin + POSE] for signals in recorded]
        rotations = [_read_rotations(path, index, pose[:, 3:]) for pose in poses]
        frame = choose_frame(free.joint, rotations)
        frames.append(frame)
        for number, pose in enumerate(poses):
            angles = frame.read_angles(rotations[number])
            positions = np.column_stack([free.factor * pose[:, :3], angles])
            converted[number] = _append(converted[number], positions)
    return tuple(frames), converted


def _append(signals: ConvertedSignals, positions: Floats) -> ConvertedSignals:
    """The signals with the positions (m, 6) of one more body."""
    middle = positions[:, 4]
    # An error of the orientation turns the first and the last angle by so much more.
    factors = np.ones_like(positions)
    factors[:, [3, 5]] = 1.0 / np.cos(middle[:, None])
    return ConvertedSignals(
        np.column_stack([signals.values, positions]),
        np.column_stack([signals.noise_factors, factors]),
        signals.is_usable & (np.abs(middle) <= MAX_MIDDLE_ANGLE_RAD),
    )


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

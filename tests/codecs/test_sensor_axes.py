"""Axes of a mounted sensor: 24 of the 48 signed permutations are mountings."""

from itertools import permutations, product

import numpy as np
import pytest

from rfca_rig.codecs.sensor_axes import NAMES, SensorAxes

ALL = [
    SensorAxes(tuple(f"{sign}{name}" for sign, name in zip(signs, order, strict=True)))
    for order in permutations(NAMES)
    for signs in product(("", "-"), repeat=3)
]
MOUNTINGS = [axes for axes in ALL if axes.is_right_handed]


def test_half_of_all_choices_are_mountings():
    assert (len(ALL), len(MOUNTINGS)) == (48, 24)
    assert all(axes.is_permutation for axes in ALL)
    assert not SensorAxes(("x", "x", "z")).is_permutation


@pytest.mark.parametrize("axes", ALL, ids=str)
def test_counts_come_back_bit_by_bit(axes):
    counts = np.random.default_rng(1).integers(-(2**31) + 1, 2**31, (50, 6), np.int32)
    turned = axes.to_rig(counts)
    assert turned.dtype == np.int32
    assert np.array_equal(axes.to_device(turned), counts)
    assert np.array_equal(turned[:, :3], counts[:, :3].astype(np.int64) @ axes.matrix.T)


@pytest.mark.parametrize("axes", MOUNTINGS, ids=str)
def test_moments_turn_as_forces_do(axes):
    force, at = np.random.default_rng(2).standard_normal((2, 3))
    device = np.concatenate([force, np.cross(at, force)])[None, :]
    ((*turned_force, mx, my, mz),) = axes.to_rig(device)
    assert np.cross(axes.matrix @ at, turned_force) == pytest.approx([mx, my, mz])


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("x", "y", "z"), "as the rig's axes"),
        (("-y", "x", "z"), "turned by 90 degrees about its z axis"),
        (("y", "-x", "z"), "turned by 90 degrees about its z axis"),
        (("-x", "-y", "z"), "turned by 180 degrees about its z axis"),
        (("-x", "y", "-z"), "turned by 180 degrees about its y axis, upside down"),
        (("y", "x", "-z"), "turned by 180 degrees, upside down"),
        (("y", "z", "x"), "turned by 120 degrees"),
        (("x", "y", "-z"), "a mirrored, left-handed frame"),
    ],
)
def test_a_mounting_is_described(names, words):
    assert SensorAxes(names).describe() == words

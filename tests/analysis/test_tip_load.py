"""The leg under a force at its tip, and the force from its shape."""

import numpy as np
import pytest

from rfca_rig.analysis.static_forces import find_tip_force, load_tip
from rfca_rig.errors import BadInput
from rfca_rig.reports.static.pictures import write_tip_load_picture
from tests.model.legs import PAPER

FORCE_N = np.array([-4.0, -18.0])


def test_the_shaft_carries_the_force_and_the_weight():
    """Moments about the shaft, from the places of the ends alone."""
    shape = load_tip(PAPER.leg, 0.5, FORCE_N)
    ends = 1e-3 * shape.ends_mm
    masses = np.array(PAPER.leg.link_masses_kg)
    middles = 0.5 * (ends[1:] + ends[:-1])
    touched = ends[-1] + [0.0, PAPER.leg.link_radius_m]
    moment = touched[0] * FORCE_N[1] - touched[1] * FORCE_N[0] + 9.81 * masses @ middles[:, 0]
    assert shape.torques_Nm[0] == pytest.approx(-moment, abs=1e-6)
    assert shape.summary()["snapped_at_share"] is None
    assert not any("snaps" in line for line in shape.lines())


def test_a_leg_that_snaps_is_reported_with_the_share_of_the_load():
    shape = load_tip(PAPER.leg, -0.5 * np.pi, np.array([0.0, 40.0]))
    share = shape.summary()["snapped_at_share"]
    assert share == pytest.approx(0.397, abs=1e-3)
    assert "the leg snaps into this shape at 39.7 % of weight and force" in list(shape.lines())


def test_a_force_does_the_work_that_springs_and_weight_take_up():
    """From no force to the whole one in small steps: the integral of F dx is the energy gained."""
    shares = np.linspace(0.0, 1.0, 201)
    shapes = [load_tip(PAPER.leg, 0.5, share * FORCE_N) for share in shares]
    masses = np.array(PAPER.leg.link_masses_kg)

    def energy(shape):
        middles = 0.5e-3 * (shape.ends_mm[1:, 1] + shape.ends_mm[:-1, 1])
        phi = shape.angles_rad[1:]
        leg = PAPER.leg
        return (
            0.5 * leg.k0_Nm_per_rad * np.sum(phi**2 + 0.5 * leg.k2_per_rad2 * phi**4)
            - 9.81 * masses @ middles
        )

    places = np.array([1e-3 * shape.ends_mm[-1] for shape in shapes])
    places[:, 0] -= PAPER.leg.link_radius_m * np.array(
        [shape.angles_rad.sum() for shape in shapes]
    )  # it rolls on a round end
    middle = 0.5 * (shares[1:] + shares[:-1])[:, None] * FORCE_N
    work = np.sum(middle * np.diff(places, axis=0))
    assert work == pytest.approx(energy(shapes[-1]) - energy(shapes[0]), rel=1e-4)


def test_the_force_is_found_from_the_shape_within_what_the_angles_allow():
    shape = load_tip(PAPER.leg, 0.5, FORCE_N)
    std = np.radians(0.2)
    random = np.random.default_rng(4)
    off = []
    for _ in range(60):
        noisy = shape.angles_rad + std * np.append(0.0, random.standard_normal(6))
        found = find_tip_force(PAPER.leg, list(noisy), std)
        off.append((found.force_N - FORCE_N) / found.std_N)
    assert np.abs(np.mean(off, axis=0)).max() < 0.4
    assert np.std(off, axis=0) == pytest.approx([1.0, 1.0], abs=0.3)


def test_what_cannot_be_is_refused_in_one_line():
    with pytest.raises(BadInput, match="2 angles: this leg has 7"):
        find_tip_force(PAPER.leg, [0.5, 0.1], 0.01)
    with pytest.raises(BadInput, match="must be above 0"):
        find_tip_force(PAPER.leg, [0.5, *(6 * [0.1])], 0.0)


def test_the_picture_shows_every_torque(tmp_path):
    shape = load_tip(PAPER.leg, 0.5, FORCE_N)
    write_tip_load_picture(shape, tmp_path / "load.svg")
    drawn = (tmp_path / "load.svg").read_text()
    assert all(
        f"{torque:.2f}".replace("-", "\u2212") in drawn or f"{torque:.2f}" in drawn
        for torque in shape.torques_Nm[1:]
    )
    with pytest.raises(BadInput, match="a picture ends in"):
        write_tip_load_picture(shape, tmp_path / "load.doc")

"""The plant's shape as a camera asks for it: absolute angles, positive downwards, of a leg that
hangs still.
"""

from dataclasses import replace
from math import cos, pi, radians
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench.leg_plant import LegPlant, TwinScatter
from rfca_rig.description.rig_file import read_rig
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.parameters import PresentEffect

RIG = read_rig(Path(__file__).parents[2] / "calibration" / "twin.toml").model()


def test_a_twin_that_is_to_fade_is_refused_as_it_counts_no_strokes():
    fading = PresentEffect("stiffness_fading", (("loss_per_decade_relative", 0.1),))
    with pytest.raises(
        BadInput, match="effect stiffness_fading: the twin does not count its strokes"
    ):
        LegPlant(
            replace(RIG, effects=(fading,)), 0.5, 0.3, 1e-3, TwinScatter(), np.random.default_rng(1)
        )


def test_every_hinge_carries_the_weight_beyond_it():
    plant = LegPlant(RIG, 0.5, 0.3, 1e-3, TwinScatter(), np.random.default_rng(1))
    angles_rad = plant.link_angles_rad()
    lengths_m = plant.link_lengths_m()
    masses_kg = RIG.leg.link_masses_kg
    assert angles_rad.shape == lengths_m.shape == (7,)
    assert angles_rad[0] == pytest.approx(plant.shaft().angle_rad) == pytest.approx(0.3)
    assert plant.ground_depth_m() == 0.5
    for hinge in range(1, 7):
        reach_m = moment_Nm = 0.0
        for link in range(hinge, 7):
            along_m = lengths_m[link] * cos(angles_rad[link])
            moment_Nm += 9.81 * masses_kg[link] * (reach_m + 0.5 * along_m)
            reach_m += along_m
        phi = angles_rad[hinge] - angles_rad[hinge - 1]
        assert RIG.leg.k0_Nm_per_rad * (phi + RIG.leg.k2_per_rad2 * phi**3) == pytest.approx(
            moment_Nm, rel=2e-3
        )


def test_the_shape_is_a_copy():
    plant = LegPlant(RIG, 0.5, pi / 6, 1e-3, TwinScatter(), np.random.default_rng(1))
    plant.link_angles_rad()[:] = 0.0
    assert plant.link_angles_rad()[0] == pytest.approx(pi / 6)


def test_a_height_without_a_rest_pose_changes_nothing():
    """The control line of a served twin answers with the error, and the twin goes on."""
    plant = LegPlant(RIG, 0.5, radians(97.9), 1e-3, TwinScatter(), np.random.default_rng(1))
    before_rad = plant.link_angles_rad()
    with pytest.raises(
        SimulationFailed,
        match=r"no rest pose found with the shaft at 97\.9 degrees and 250\.0 mm above the ground",
    ):
        plant.set_height(0.25)
    assert plant.ground_depth_m() == 0.5
    assert (plant.link_angles_rad() == before_rad).all()
    plant.set_height(0.2)
    assert plant.ground_depth_m() == 0.2

"""Rest angles are found together with the curve, or at least noticed."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.stages import Instruments
from rfca_rig.analysis.torque_rotation.static_result import remarks
from rfca_rig.description.model_file import nominal_model
from rfca_rig.exam.nominal_world import nominal_world
from tests.analysis.torque_rotation.tables import (
    KNOWN_TO,
    SECTIONS,
    by_exam,
    noisy,
    plain,
    recording,
)

ONE = (0.0, 0.0, 1.5, 0.0, 0.0, 0.0)
ALL = (1.5,) * 6
STATED = {**KNOWN_TO, "rest_angle_deg": 2.0}


def stages_with(rest_deg):
    world = nominal_world(0.215)
    return by_exam(
        replace(world, hinges=replace(world.hinges, preset_rad=tuple(np.radians(rest_deg))))
    )


def with_marks_off(stages, rng, std_deg):
    marks = rng.normal(0.0, std_deg, 6)
    return tuple(
        replace(stage, hinge_deg=tuple(np.array(stage.hinge_deg) + marks)) for stage in stages
    )


def found_in(stages, known_to=STATED, sections=SECTIONS, marks_deg=0.1):
    return evaluate(
        [recording(stages)], StageAssumptions(sections, known_to, Instruments(marks_deg=marks_deg))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "rest_deg", [ONE, ALL, tuple(-angle for angle in ALL)], ids=["one", "all", "all the other way"]
)
def test_rest_angles_are_recovered_to_a_tenth_of_a_degree_beside_the_curve(rest_deg):
    """16 stages, each hinge angle with the 0.1 degrees of a photo."""
    result = found_in(noisy(stages_with(rest_deg), np.random.default_rng(0)))
    assert result.form.holds
    for rests in result.rests:
        assert np.degrees(rests.rest_rad) == pytest.approx(np.array(rest_deg), abs=0.1)
        assert np.degrees(rests.std_rad).max() < 0.12
    assert result.values.k0_Nm_per_rad == pytest.approx(11.0, abs=3.0 * result.values.k0_std)
    assert result.values.k0_std < 0.07
    assert remarks(result) == []


@pytest.mark.slow
def test_their_errors_cover_what_marks_and_photos_do_to_them():
    """Marks that sit beside their hinges look like rest angles; how far they may is what limits
    these.
    """
    rng = np.random.default_rng(4)
    pulls = []
    common = []
    clean = stages_with(ALL)
    for _ in range(12):
        (rests, _) = found_in(noisy(with_marks_off(clean, rng, 0.1), rng)).rests
        off = rests.rest_rad - np.radians(1.5)
        pulls.append(off / rests.std_rad)
        common.append(off.mean() / rests.common_std_rad)
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.4
    assert 0.5 < np.sqrt(np.mean(np.square(common))) < 1.6


@pytest.mark.slow
def test_better_marks_give_better_rest_angles():
    stages = noisy(stages_with(ONE), np.random.default_rng(1))
    coarse, fine = (found_in(stages, marks_deg=marks_deg).rests[0] for marks_deg in (0.1, 0.02))
    assert fine.std_rad.max() < 0.6 * coarse.std_rad.max()


def test_a_common_rest_angle_and_the_stiffness_at_rest_stand_in_for_each_other_in_part():
    with_rest = found_in(noisy(plain(), np.random.default_rng(2)))
    exact = found_in(noisy(plain(), np.random.default_rng(2)), KNOWN_TO)
    law, curve = with_rest.rests
    assert -0.95 < law.with_stiffness < -0.5
    assert -0.95 < curve.with_stiffness < -0.3
    assert with_rest.values.k0_std > 1.3 * exact.values.k0_std
    assert exact.rests == (None, None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rest_deg", "said"),
    [(ONE, "Hinge 4 looks as if it rests at +1."), (ALL, "All hinges look as if they rest at +1.")],
    ids=["one", "all"],
)
def test_rest_angles_that_nobody_stated_are_noticed(rest_deg, said):
    found = remarks(found_in(noisy(stages_with(rest_deg), np.random.default_rng(0)), KNOWN_TO))
    assert sum("With rest_angle_deg in [known_to]" in each for each in found) == 1
    assert any(each.startswith(said) for each in found)


def test_rest_angles_that_are_believed_are_taken_off():
    bent = {**SECTIONS, "leg": {**SECTIONS["leg"], "rest_angles_deg": list(ONE)}}
    assert nominal_model(bent).leg.rest_angles_rad[2] == pytest.approx(np.radians(1.5))
    result = found_in(noisy(stages_with(ONE), np.random.default_rng(0)), KNOWN_TO, bent)
    assert remarks(result) == []
    assert result.values.k0_Nm_per_rad == pytest.approx(11.0, rel=0.005)
    raw = np.degrees(
        [hinge for stage in result.data.stages for hinge in np.radians(stage.hinge_deg[2:3])]
    )
    assert np.degrees(result.points.phi_rad[:, 2]) == pytest.approx(raw - 1.5, abs=0.1)


def test_the_measured_curve_reaches_as_far_as_hinges_bend_from_where_they_rest():
    """With knots counted from zero the outermost one lies 3.5 degrees short, and the spline is
    straight beyond it.
    """
    result = found_in(noisy(stages_with((4.0,) * 6), np.random.default_rng(0)))
    assert np.degrees(result.model.basis.knots_rad[-1]) == pytest.approx(
        np.degrees(np.abs(result.model.range_rad).max()), abs=0.2
    )
    assert np.degrees(result.rests[1].rest_rad) == pytest.approx(4.0, abs=0.1)

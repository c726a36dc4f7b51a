"""What does not fit one law for all hinges is said."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.static_result import remarks
from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.sampled_rig import with_effect
from tests.analysis.torque_rotation.tables import (
    KNOWN_TO,
    SECTIONS,
    by_exam,
    noisy,
    plain,
    recording,
)

SUPPOSED = StageAssumptions(SECTIONS, KNOWN_TO)


def of(effect: str, **values: float):
    world = with_effect(nominal_world(0.215), effect, values)
    return evaluate([recording(noisy(by_exam(world), np.random.default_rng(5)))], SUPPOSED)


def test_play_in_the_hinges_breaks_the_law_and_splines_follow_it():
    result = of("hinge_backlash", half_gap_deg=1.2)
    assert not result.form.holds
    assert result.curve is result.free
    assert "does not hold" in remarks(result)[0]
    x = result.curve.grid_rad()[8:] + np.radians(
        1.2
    )  # the angles are negative; the spring engages past the gap
    assert result.curve.torque_Nm(result.curve.grid_rad()[8:])[0] == pytest.approx(
        11.0 * (x + 4.2 * x**3), abs=0.03
    )


def test_dry_friction_shows_as_a_loop_of_its_height():
    result = of("hinge_coulomb_friction", torque_Nm=0.1)
    assert result.loop is not None
    assert result.loop.seen
    assert result.loop.half_Nm == pytest.approx(
        0.05, abs=0.02
    )  # a small turn back shows half of it
    assert any("loop" in said for said in remarks(result))
    assert result.loop.unbending > 0


def test_without_friction_there_is_no_loop():
    loop = evaluate([recording(noisy(plain(), np.random.default_rng(6)))], SUPPOSED).loop
    assert loop is not None
    assert not loop.seen


def test_without_reversals_nothing_is_said_of_a_loop():
    stages = [stage for stage in plain() if stage.direction == "loading"]
    assert evaluate([recording(noisy(stages, np.random.default_rng(6)))], SUPPOSED).loop is None


def test_a_weak_hinge_is_named():
    result = of("damaged_hinge", hinge=4.0, stiffness_factor=0.9)
    assert [check.hinge for check in result.hinges if check.is_significant] == [4]
    assert any(said.startswith("Hinge 4 is 1") and "softer" in said for said in remarks(result))


def test_a_stop_that_only_some_hinges_reach_leaves_forces_that_fit_no_curve():
    assert any(
        "Forces and angles do not go together" in said
        for said in remarks(of("hinge_stop", angle_deg=18.0, stiffness_Nm_per_rad=30.0))
    )


def test_a_floor_that_is_not_level_is_told():
    assert any(
        "slope of the floor would be +" in said for said in remarks(of("ground_tilt", slope=0.03))
    )


@pytest.mark.slow
def test_repeats_that_agree_narrow_the_errors_and_repeats_that_do_not_widen_them():
    rng = np.random.default_rng(9)
    alike = [recording(noisy(plain(), rng), f"run {i}") for i in range(3)]
    stiffer = nominal_world(0.215)
    stiffer = replace(stiffer, hinges=replace(stiffer.hinges, k0_Nm_per_rad=(11.6,) * 6))
    unlike = [*alike[:2], recording(noisy(by_exam(stiffer), rng), "run 3")]
    one, three, apart = (evaluate(which, SUPPOSED) for which in (alike[:1], alike, unlike))
    assert three.values.k0_std < one.values.k0_std
    assert len(three.repeats.values) == 3
    assert three.repeats.widened < 1.8
    assert apart.repeats.widened > 3.0
    assert apart.values.k0_std > 2.0 * three.values.k0_std
    # A richer form is known less well than the law.
    by_law_alone = float(np.sqrt(apart.found.adjusted.covariance[0, 0]))
    assert apart.values.k0_std > 0.99 * apart.repeats.widened * by_law_alone
    assert any("differ more than" in said for said in remarks(apart))

"""The recovered curve on tables of engines that share no code with the analysis."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.recovery import mark_correlation
from rfca_rig.analysis.torque_rotation.stages import MARKS_DEG, SLOPE, Instruments
from rfca_rig.analysis.torque_rotation.static_result import remarks
from rfca_rig.exam.nominal_world import apply_nominal_errors, draw_nominal_errors, nominal_world
from rfca_rig.exam.simulator.world import for_each_hinge
from tests.analysis.torque_rotation.tables import (
    KNOWN_TO,
    NOISE,
    RIG,
    SECTIONS,
    by_exam,
    by_mujoco,
    noisy,
    plain,
    recording,
)

SUPPOSED = StageAssumptions(SECTIONS, KNOWN_TO)
needs_mujoco = pytest.mark.skipif(
    find_spec("mujoco") is None,
    reason='MuJoCo is not installed: pip install "rfca-rig[crosscheck]"',
)


def law(rig, phi):
    return rig.leg.k0_Nm_per_rad * (phi + rig.leg.k2_per_rad2 * phi**3)


def with_hinges(k0: float, k2: float):
    return replace(RIG, leg=replace(RIG.leg, k0_Nm_per_rad=k0, k2_per_rad2=k2))


def covered(result, rig) -> float:
    """Share of the range in which the true curve is inside the band."""
    phi = result.law.grid_rad(41)
    torque, std = result.law.torque_Nm(phi)
    return float(np.mean(np.abs(torque - law(rig, phi)) <= result.law.reach * std))


def test_a_clean_table_gives_the_law_back():
    result = evaluate([recording(plain())], SUPPOSED)
    assert result.values.k0_Nm_per_rad == pytest.approx(11.0, rel=2e-3)
    assert result.values.k2_per_rad2 == pytest.approx(4.2, rel=5e-3)
    assert remarks(result) == []
    assert set(result.found.ends) == {(6,)}


def test_curve_stiffness_and_bands_of_a_noisy_table():
    result = evaluate([recording(noisy(plain(), np.random.default_rng(3), 0.15))], SUPPOSED)
    phi = result.curve.grid_rad()
    stiffness, std = result.curve.stiffness_Nm_per_rad(phi)
    assert result.form.holds
    assert covered(result, RIG) == 1.0
    assert np.abs(stiffness - 11.0 * (1.0 + 12.6 * phi**2)).max() < 0.02 * 33.0
    assert (np.abs(stiffness - 11.0 * (1.0 + 12.6 * phi**2)) <= result.curve.reach * std).all()
    assert np.degrees(result.found.errors.hinge_std_rad) == pytest.approx(0.15, rel=0.25)
    assert np.gradient(result.curve.torque_Nm(phi)[0], phi, edge_order=2) == pytest.approx(
        stiffness, rel=1e-3
    )


def test_what_was_stated_of_the_angles_is_used_and_marks_that_neighbours_share_are_noticed():
    rng = np.random.default_rng(8)
    correlated = np.linalg.cholesky(mark_correlation(RIG.leg.link_lengths_m))
    stages = tuple(
        replace(
            stage,
            hinge_deg=tuple(np.array(stage.hinge_deg) + 0.12 * correlated @ rng.normal(size=6)),
            hinge_std_deg=(0.12,) * 6,
        )
        for stage in noisy(plain(), rng, 0.0)
    )
    result = evaluate([recording(stages)], SUPPOSED)
    assert result.found.errors.chained
    assert result.found.errors.stated_factor == pytest.approx(1.0, abs=0.25)
    assert covered(result, RIG) == 1.0


def test_correlation_of_angles_between_shared_marks():
    correlation = mark_correlation((0.04,) * 6)
    assert correlation[2, :] == pytest.approx([1 / 6, -2 / 3, 1.0, -2 / 3, 1 / 6])


@pytest.mark.slow
@needs_mujoco
@pytest.mark.parametrize(("heights_m", "most_touching"), [((0.215, 0.235), 1), ((0.15, 0.17), 3)])
def test_friction_of_any_sign_and_several_ends_on_the_floor(heights_m, most_touching):
    """Equilibria of MuJoCo in which the floor holds every end with friction drawn at random."""
    rng = np.random.default_rng(2)
    rig = with_hinges(9.0, 3.0)
    clean = [
        stage
        for height_m in heights_m
        for stage in by_mujoco(rig, height_m, (60, 70, 80, 90, 100, 110, 120, 130), rng)
    ]
    assert len(clean) >= 12
    result = evaluate([recording(noisy(clean, rng, 0.1))], SUPPOSED)
    assert max(len(ends) for ends in result.found.ends) == most_touching
    assert result.values.k0_Nm_per_rad == pytest.approx(9.0, rel=0.005)
    assert result.values.k2_per_rad2 == pytest.approx(3.0, rel=0.015)
    assert covered(result, rig) == 1.0


@needs_mujoco
def test_ends_that_seem_to_hang_clear_of_a_floor_said_to_be_deeper_are_found():
    rng = np.random.default_rng(2)
    clean = [
        stage
        for height_m in (0.15, 0.17)
        for stage in by_mujoco(RIG, height_m, (60, 70, 80, 90, 100, 110, 120, 130), rng)
    ]
    too_high = [replace(stage, height_m=stage.height_m + 0.012) for stage in noisy(clean, rng, 0.1)]
    result = evaluate(
        [recording(too_high)], replace(SUPPOSED, known_to={**KNOWN_TO, "height_mm": 5.0})
    )
    assert max(len(ends) for ends in result.found.ends) == 3
    assert result.values.k0_Nm_per_rad == pytest.approx(11.0, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "k0_rel"),
    [
        (lambda w: replace(w, floor=replace(w.floor, stiffness=1e6)), 0.004),
        (lambda w: replace(w, floor=replace(w.floor, slope=0.02)), 0.006),
        (lambda w: replace(w, mount=replace(w.mount, height_m=w.mount.height_m + 0.002)), 0.008),
        (lambda w: replace(w, floor=replace(w.floor, lever_share=0.5)), 0.006),
    ],
    ids=["stiff floor", "floor not level", "rack higher", "friction elsewhere"],
)
def test_a_floor_that_is_not_as_believed_hardly_bends_the_curve(change, k0_rel):
    result = evaluate(
        [recording(noisy(by_exam(change(nominal_world(0.215))), np.random.default_rng(1)))],
        SUPPOSED,
    )
    phi = result.curve.grid_rad()[5:]
    assert result.curve.torque_Nm(phi)[0] == pytest.approx(law(RIG, phi), rel=k0_rel)


def test_a_gain_in_doubt_widens_the_band_by_as_much():
    stages = [recording(noisy(plain(), np.random.default_rng(4)))]
    known, doubted = (
        evaluate(stages, replace(SUPPOSED, instruments=Instruments(gain))).values
        for gain in (0.0, 0.02)
    )
    assert known.k0_std / known.k0_Nm_per_rad < 0.004
    assert doubted.k0_std / doubted.k0_Nm_per_rad == pytest.approx(0.02, rel=0.1)


def worlds(count: int):
    """Rigs off what is believed of them, floor and all, with hinges of all kinds."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        off = draw_nominal_errors(rng)
        k0 = rng.uniform(8.0, 14.0)
        k2 = rng.uniform(1.5, 6.0)
        world = apply_nominal_errors(nominal_world(0.215), off)
        floor = replace(
            world.floor,
            slope=float(rng.normal(0.0, SLOPE)),
            lever_share=float(rng.uniform(-0.3, 0.3)),
        )
        hinges = replace(
            world.hinges, k0_Nm_per_rad=for_each_hinge(k0), k2_per_rad2=for_each_hinge(k2)
        )
        yield replace(world, hinges=hinges, floor=floor), with_hinges(k0, k2)


def off_zero(stages, rng):
    """Tares, marks and encoder off by as much as they are said to be."""
    tare = rng.normal(0.0, list(NOISE.values()))
    marks = rng.normal(0.0, MARKS_DEG, 6)
    shaft = np.radians(rng.normal(0.0, 0.3))
    return tuple(
        replace(
            stage,
            hinge_deg=tuple(np.array(stage.hinge_deg) + marks),
            shaft_angle_rad=stage.shaft_angle_rad + float(shaft),
            fy_N=stage.fy_N + tare[0],
            fz_N=stage.fz_N + tare[1],
            tx_Nm=stage.tx_Nm + tare[2],
        )
        for stage in stages
    )


def pulls_and_cover(count: int, draws: int):
    rng = np.random.default_rng(1)
    pulls = []
    cover = []
    alarms = 0
    for world, rig in worlds(count):
        clean = by_exam(world)
        for _ in range(draws):
            table = noisy(off_zero(clean, rng), rng, rng.uniform(0.05, 0.2), rng.uniform(1.0, 4.0))
            result = evaluate([recording(table)], SUPPOSED)
            pulls.append(
                (result.values.k0_Nm_per_rad - rig.leg.k0_Nm_per_rad) / result.values.k0_std
            )
            cover.append(covered(result, rig))
            alarms += not result.form.holds or bool(remarks(result))
    return np.array(pulls), float(np.mean(cover)), alarms


@pytest.mark.long
def test_the_band_covers():
    pulls, cover, alarms = pulls_and_cover(6, 2)
    assert cover >= 0.85
    assert abs(pulls.mean()) < 1.0
    assert 0.3 < pulls.std() < 1.5
    assert alarms == 0


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_band_covers_as_often_as_it_says():
    pulls, cover, alarms = pulls_and_cover(50, 4)
    assert 0.90 <= cover <= 0.99
    assert abs(pulls.mean()) < 0.25
    assert alarms <= 2

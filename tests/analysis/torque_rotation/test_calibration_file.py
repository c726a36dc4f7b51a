"""The model file that static stages leave."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.analysis.torque_rotation.bases import Hardening, TorqueCurve, law_values
from rfca_rig.analysis.torque_rotation.calibration_file import (
    can_be_written,
    can_curve_be_written,
    write_calibration,
    write_curve,
)
from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.static_result import predict_hinge_curves, remarks
from rfca_rig.description.model_file import read_model_file
from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.sampled_rig import with_effect
from rfca_rig.model.hinge_springs import bending_torque_Nm
from tests.analysis.torque_rotation.tables import (
    KNOWN_TO,
    RIG,
    SECTIONS,
    by_exam,
    noisy,
    plain,
    recording,
)

SUPPOSED = StageAssumptions(SECTIONS, KNOWN_TO)


@pytest.fixture(scope="module")
def result():
    return evaluate([recording(noisy(plain(), np.random.default_rng(2)))], SUPPOSED)


def test_hinges_and_how_well_they_are_known_come_back_from_the_file(tmp_path, result):
    write_calibration(
        tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, ["a table\nof two lines"]
    )
    read = read_model_file(tmp_path / "model.toml")
    assert read.leg.k0_Nm_per_rad == pytest.approx(result.values.k0_Nm_per_rad, rel=1e-6)
    assert read.leg.k2_per_rad2 == pytest.approx(result.values.k2_per_rad2, rel=1e-6)
    known = read.known_to.model_dump(exclude_none=True)
    assert known["k0_relative"] == pytest.approx(
        result.values.k0_std / result.values.k0_Nm_per_rad, rel=1e-4
    )
    assert known["k2_relative"] == pytest.approx(
        result.values.k2_std / result.values.k2_per_rad2, rel=1e-4
    )
    assert {name: known[name] for name in KNOWN_TO if name != "k0_relative"} == {
        n: v for n, v in KNOWN_TO.items() if n != "k0_relative"
    }
    assert replace(read.model(), leg=RIG.leg) == RIG


def test_a_fit_takes_the_errors_for_its_prior(tmp_path, result):
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, [])
    read = read_model_file(tmp_path / "model.toml")
    space = make_prior(
        ("k0", "k2"), ModelPoint(read.model()), read.known_to.model_dump(exclude_none=True)
    )
    assert space.has_prior.all()
    assert space.prior_std == pytest.approx([result.values.k0_std, result.values.k2_std], rel=1e-4)


def test_where_the_law_fails_its_values_are_known_no_better_than_it_fails(tmp_path):
    world = with_effect(nominal_world(0.215), "hinge_backlash", {"half_gap_deg": 1.2})
    result = evaluate([recording(noisy(by_exam(world), np.random.default_rng(5)))], SUPPOSED)
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, [])
    assert (
        read_model_file(tmp_path / "model.toml").known_to.k0_relative
        > abs(result.form.apart_relative)
        > 0.02
    )
    assert "# The law k0 (phi + k2 phi^3) does not hold" in (tmp_path / "model.toml").read_text()


SOFT = replace(
    nominal_world(0.215),
    hinges=replace(nominal_world(0.215).hinges, k0_Nm_per_rad=(14.0,) * 6, k2_per_rad2=(-0.7,) * 6),
)


def written_curve(path, result, sections=SECTIONS, known_to=KNOWN_TO):
    write_curve(path, result, sections, known_to, ["a table"])
    return read_model_file(path)


def test_the_measured_curve_comes_back_from_its_file_with_its_covariance(tmp_path, result):
    read = written_curve(
        tmp_path / "model-curve.toml", result, known_to={**KNOWN_TO, "k2_relative": 0.1}
    )
    knots = np.array(result.model.basis.knots_rad)
    assert bending_torque_Nm(read.model().leg, knots) == pytest.approx(
        result.model.coefficients, abs=1e-6
    )
    assert bending_torque_Nm(read.model().leg, 0.7 * knots) == pytest.approx(
        result.model.torque_Nm(0.7 * knots)[0], abs=1e-6
    )
    covariance = np.array(read.leg.torque_rotation.covariance_Nm2)
    assert covariance == pytest.approx(result.model.covariance, rel=1e-4)
    band = np.sqrt(np.trace(covariance) / np.sum(result.model.coefficients**2))
    assert read.known_to.k0_relative == pytest.approx(band, rel=1e-3)
    assert read.known_to.k2_relative is None
    assert read.known_to.height_mm == KNOWN_TO["height_mm"]


@pytest.mark.parametrize(("height_m", "speed_rad_s"), [(0.215, 2.433), (0.235, 4.5)])
def test_strokes_of_the_measured_curve_are_those_of_the_law_to_a_tenth_of_a_percent(
    tmp_path, result, height_m, speed_rad_s
):
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, [])
    written_curve(tmp_path / "model-curve.toml", result)
    models = [
        read_model_file(tmp_path / name).model() for name in ("model.toml", "model-curve.toml")
    ]
    law, curve = (predict_stroke(model, height_m, speed_rad_s, 200.0).summary() for model in models)
    assert curve["valley_fz_N"] == pytest.approx(law["valley_fz_N"], rel=1e-3)
    assert curve["valley_time_s"] == pytest.approx(law["valley_time_s"], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["softening", "play"])
def test_a_curve_that_is_no_cubic_is_met_within_its_band_from_the_first_angles_on(tmp_path, case):
    gap = float(np.radians(1.2))
    if case == "softening":
        world = SOFT
    else:
        world = with_effect(nominal_world(0.215), "hinge_backlash", {"half_gap_deg": 1.2})
    result = evaluate([recording(noisy(by_exam(world), np.random.default_rng(5)))], SUPPOSED)
    leg = written_curve(tmp_path / "model-curve.toml", result).model().leg
    x = np.radians(np.linspace(7.0, 22.0, 40))
    if case == "softening":
        true = 14.0 * (x - 0.7 * x**3)
    else:
        true = 11.0 * ((x - gap) + 4.2 * (x - gap) ** 3)
    assert bending_torque_Nm(leg, x) == pytest.approx(true, abs=0.003 * true.max())
    assert result.model_form.holds
    assert np.abs(law_of(result, x) - true).max() > (0.01 * true.max() if case == "play" else 0.0)


def law_of(result, x):
    return result.values.k0_Nm_per_rad * (x + result.values.k2_per_rad2 * x**3)


def test_rest_angles_go_into_both_files(tmp_path):
    world = nominal_world(0.215)
    bent = replace(
        world,
        hinges=replace(world.hinges, preset_rad=(0.0, 0.0, float(np.radians(1.5)), 0.0, 0.0, 0.0)),
    )
    known_to = {**KNOWN_TO, "rest_angle_deg": 2.0}
    result = evaluate(
        [recording(noisy(by_exam(bent), np.random.default_rng(0)))],
        StageAssumptions(SECTIONS, known_to),
    )
    write_calibration(tmp_path / "model.toml", result, SECTIONS, known_to, [])
    for read, rests in zip(
        (read_model_file(tmp_path / "model.toml"), written_curve(tmp_path / "c.toml", result)),
        result.rests,
        strict=True,
    ):
        assert np.array(read.leg.rest_angles_deg) == pytest.approx(
            np.degrees(rests.rest_rad), abs=1e-6
        )
        assert read.known_to.rest_angle_deg == pytest.approx(
            np.degrees(rests.std_rad.max()), rel=1e-4
        )


def test_a_leg_that_was_believed_to_follow_a_curve_is_evaluated_and_written_either_way(
    tmp_path, result
):
    first = written_curve(tmp_path / "first.toml", result)
    nominal = first.nominal()
    known_to = first.known_to.model_dump(exclude_none=True)
    again = evaluate(
        [recording(noisy(plain(), np.random.default_rng(2)))], StageAssumptions(nominal, known_to)
    )
    assert again.values.k0_Nm_per_rad == pytest.approx(result.values.k0_Nm_per_rad, rel=1e-4)
    write_calibration(tmp_path / "law.toml", again, nominal, known_to, [])
    assert read_model_file(tmp_path / "law.toml").leg.k0_Nm_per_rad == pytest.approx(
        result.values.k0_Nm_per_rad, rel=1e-4
    )
    second = written_curve(tmp_path / "second.toml", again, nominal, known_to)
    assert second.leg.torque_rotation.torques_Nm == pytest.approx(
        first.leg.torque_rotation.torques_Nm, abs=1e-4
    )


def test_a_curve_that_falls_makes_no_model(result):
    falling = replace(
        result, model=replace(result.model, coefficients=np.array([1.0, 0.9, 3.0, 5.0]))
    )
    assert can_curve_be_written(result)
    assert not can_curve_be_written(falling)
    assert any(
        "No model can take the measured curve: the measured curve: torque 2" in said
        for said in remarks(falling)
    )


def test_hinges_that_soften_make_no_model(result):
    softer = TorqueCurve(
        Hardening(), np.array([11.0, -5.0]), np.diag([1e-4, 1e-2]), (-0.4, 0.0), -1.0, 100
    )
    assert can_be_written(result)
    assert not can_be_written(replace(result, values=law_values(softer)))


def test_errors_of_the_law_by_differences():
    covariance = np.array([[4e-4, -2e-3], [-2e-3, 9e-2]])
    values = law_values(
        TorqueCurve(Hardening(), np.array([11.0, 46.2]), covariance, (0.0, 0.4), 1.0, 100)
    )
    drawn = np.random.default_rng(0).multivariate_normal([11.0, 46.2], covariance, 200_000)
    assert values.k2_std == pytest.approx(np.std(drawn[:, 1] / drawn[:, 0]), rel=0.01)
    assert values.correlation == pytest.approx(
        np.corrcoef(drawn[:, 0], drawn[:, 1] / drawn[:, 0])[0, 1], abs=0.01
    )


def test_the_elastica_of_the_papers_strip():
    held, over_link, over_k0 = predict_hinge_curves(RIG.leg, 11.0, 0.4)
    assert held.k0_Nm_per_rad == pytest.approx(
        120e9 * 2 * 25.4e-3 * 0.8e-3**3 / 12 / 0.039333, rel=1e-3
    )
    assert over_link.k0_Nm_per_rad == pytest.approx(held.k0_Nm_per_rad, rel=1e-3)
    assert over_link.k2_per_rad2 == pytest.approx(1 / 6, rel=0.05)
    assert over_k0.k0_Nm_per_rad == pytest.approx(11.0, rel=1e-3)
    assert over_k0.stiffness_Nm_per_rad[0] == pytest.approx(11.0, rel=1e-3)

"""The model file that static stages leave."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import Supposed, space_of
from rfca_rig.analysis.torque_rotation.calibration_file import can_be_written, write_calibration
from rfca_rig.analysis.torque_rotation.curve import TorqueCurve, law_values
from rfca_rig.analysis.torque_rotation.elastica_curves import foretold
from rfca_rig.analysis.torque_rotation.evaluate import Supposition, evaluate
from rfca_rig.description.model_file import read_model_file
from rfca_rig.exam.believed import believed_world
from rfca_rig.exam.concealed import with_effect
from tests.analysis.torque_rotation.tables import KNOWN_TO, RIG, SECTIONS, by_exam, noisy, plain, recording

SUPPOSED = Supposition(SECTIONS, KNOWN_TO)


@pytest.fixture(scope="module")
def result():
    return evaluate([recording(noisy(plain(), np.random.default_rng(2)))], SUPPOSED)


def test_hinges_and_how_well_they_are_known_come_back_from_the_file(tmp_path, result):
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, ["a table\nof two lines"])
    read = read_model_file(tmp_path / "model.toml")
    assert read.leg.k0_Nm_per_rad == pytest.approx(result.values.k0_Nm_per_rad, rel=1e-6)
    assert read.leg.k2_per_rad2 == pytest.approx(result.values.k2_per_rad2, rel=1e-6)
    known = read.known_to.model_dump(exclude_none=True)
    assert known["k0_relative"] == pytest.approx(result.values.k0_std / result.values.k0_Nm_per_rad, rel=1e-4)
    assert known["k2_relative"] == pytest.approx(result.values.k2_std / result.values.k2_per_rad2, rel=1e-4)
    assert {name: known[name] for name in KNOWN_TO if name != "k0_relative"} == {n: v for n, v in KNOWN_TO.items() if n != "k0_relative"}
    assert replace(read.model(), leg=RIG.leg) == RIG


def test_a_fit_takes_the_errors_for_its_prior(tmp_path, result):
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, [])
    read = read_model_file(tmp_path / "model.toml")
    space = space_of(("k0", "k2"), Supposed(read.model()), read.known_to.model_dump(exclude_none=True))
    assert space.has_prior.all()
    assert space.prior_std == pytest.approx([result.values.k0_std, result.values.k2_std], rel=1e-4)


def test_where_the_law_fails_its_values_are_known_no_better_than_it_fails(tmp_path):
    world = with_effect(believed_world(0.215), "hinge_backlash", {"half_gap_deg": 1.2})
    result = evaluate([recording(noisy(by_exam(world), np.random.default_rng(5)))], SUPPOSED)
    write_calibration(tmp_path / "model.toml", result, SECTIONS, KNOWN_TO, [])
    assert read_model_file(tmp_path / "model.toml").known_to.k0_relative > abs(result.form.apart_relative) > 0.02
    assert "# The law k0 (phi + k2 phi^3) does not hold" in (tmp_path / "model.toml").read_text()


def test_hinges_that_soften_make_no_model(result):
    softer = TorqueCurve(result.law.basis, np.array([11.0, -5.0]), result.law.covariance, (-0.4, 0.0), -1.0, 100)
    assert can_be_written(result)
    assert not can_be_written(replace(result, values=law_values(softer)))


def test_errors_of_the_law_by_differences():
    covariance = np.array([[4e-4, -2e-3], [-2e-3, 9e-2]])
    values = law_values(TorqueCurve(None, np.array([11.0, 46.2]), covariance, (0.0, 0.4), 1.0, 100))
    drawn = np.random.default_rng(0).multivariate_normal([11.0, 46.2], covariance, 200_000)
    assert values.k2_std == pytest.approx(np.std(drawn[:, 1] / drawn[:, 0]), rel=0.01)
    assert values.correlation == pytest.approx(np.corrcoef(drawn[:, 0], drawn[:, 1] / drawn[:, 0])[0, 1], abs=0.01)


def test_the_elastica_of_the_papers_strip():
    held, over_link, over_k0 = foretold(RIG.leg, 11.0, 0.4)
    assert held.k0_Nm_per_rad == pytest.approx(120e9 * 2 * 25.4e-3 * 0.8e-3**3 / 12 / 0.039333, rel=1e-3)
    assert over_link.k0_Nm_per_rad == pytest.approx(held.k0_Nm_per_rad, rel=1e-3)
    assert over_link.k2_per_rad2 == pytest.approx(1 / 6, rel=0.05)
    assert over_k0.k0_Nm_per_rad == pytest.approx(11.0, rel=1e-3)
    assert over_k0.stiffness_Nm_per_rad[0] == pytest.approx(11.0, rel=1e-3)

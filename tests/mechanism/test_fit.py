"""`fit` of recordings of a mechanism: nominal values, effects that are named, errors on held-out
conditions, the amended model.
"""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import FitOptions
from rfca_rig.mechanism.load import load_mechanism
from tests.cli.typed import typed
from tests.mechanism.arm import Arm, Friction, record, write_campaign

KNOWN_TO = {"mass_relative": 0.02, "centre_of_mass_m": 0.003, "zero_offset_rad": 0.002}


def make(folder, arm):
    return write_campaign(folder, Arm(), [record(arm, 3.4, seed) for seed in (0, 1)], KNOWN_TO)


@pytest.fixture(scope="module")
def dry(tmp_path_factory):
    return make(
        tmp_path_factory.mktemp("dry") / "arm", replace(Arm(), friction=Friction((0.0, 0.4, 0.0)))
    )


@pytest.fixture(scope="module")
def off(tmp_path_factory):
    """Nothing is missing, but the second link is heavier and the first encoder reads too much."""
    return make(
        tmp_path_factory.mktemp("off") / "arm",
        replace(Arm(), mass_kg=(2.0, 1.45, 0.7), zero_rad=(0.004, 0.0, 0.0)),
    )


def fitted(folder, names=(), effects=()):
    shares = []
    problem = MechanismProblem(read_experiment(folder))
    found = problem.fit(FitOptions(names, effects), lambda _, share: shares.append(share))
    assert shares == sorted(shares)
    return found


@pytest.mark.slow
def test_nominal_values_are_found_within_their_errors(off):
    found = fitted(off, names=["mass_relative", "joint1.zero_offset_rad"]).fit
    shifts = {shift.name: shift for shift in found.shifts}
    assert list(shifts) == [
        "link1.mass_relative",
        "link2.mass_relative",
        "link3.mass_relative",
        "joint1.zero_offset_rad",
    ]
    truth = {
        "link1.mass_relative": 0.0,
        "link2.mass_relative": 0.05 / 1.4,
        "link3.mass_relative": 0.0,
        "joint1.zero_offset_rad": 0.004,
    }
    for name, shift in shifts.items():
        assert shift.value == pytest.approx(truth[name], abs=3.0 * shift.std)
        assert shift.std < 0.8 * shift.prior_std
    assert all(
        error.fitted < error.held_out < error.nominal
        for error in found.totals
        if error.signal.endswith("_rad")
    )


@pytest.mark.slow
def test_an_effect_that_is_named_is_found_and_stands_in_the_amended_model(
    dry, tmp_path, monkeypatch, capsys
):
    words = (
        "fit",
        dry,
        "--effects",
        "joint_friction_of_one",
        "--parameters",
        "mass_relative",
        "--out",
        tmp_path / "model.xml",
        "--json",
    )
    found = json.loads(typed(monkeypatch, capsys, *words).out)
    assert found["format"] == "rfca-mechanism-fit/1"
    joint, size = found["effects"]
    assert (joint["name"], joint["value"], joint["std"]) == ("joint", 2.0, None)
    assert (size["name"], size["value"]) == ("torque_Nm", pytest.approx(0.4, rel=0.05))
    assert 0.0 < size["std"] < 0.02
    for error in found["totals"]:
        assert error["noise"] < error["fitted"] < 1.5 * error["held_out"] < 0.5 * error["nominal"]
    assert len(found["errors"]) == 2 * len(found["totals"]) == 12
    assert load_mechanism(tmp_path / "model.xml").model.dof_frictionloss == pytest.approx(
        [0.0, size["value"], 0.0], rel=1e-4
    )


@pytest.mark.slow
def test_friction_of_joints_that_have_none_is_at_the_end_of_its_range(dry):
    sizes = fitted(dry, names=["mass_relative"], effects=["joint_friction"]).fit.sizes
    assert [size.at_bound for size in sizes] == [True, False, True]
    assert sizes[1].value == pytest.approx(0.4, rel=0.1)


@pytest.mark.slow
def test_values_that_do_the_same_are_said_to(dry, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "fit", dry, "--effects", "joint_friction_of_one")
    assert said.exit_code == 0
    assert "link3.mass_relative and link3.centre_of_mass_m are correlated to -0.9" in said.out
    assert max(map(len, said.out.splitlines())) <= 80
    assert "joint_friction_of_one.torque_Nm" in said.out
    assert "joint2_position_rad" in said.out


@pytest.mark.slow
def test_what_mjcf_does_not_hold_of_a_fit_is_said(off, tmp_path, monkeypatch, capsys):
    said = typed(
        monkeypatch,
        capsys,
        "fit",
        off,
        "--parameters",
        "zero_offset_rad",
        "--out",
        tmp_path / "model.xml",
    )
    assert "MJCF does not hold zero offsets of the readings" in said.err
    assert f"rfca-rig report {off} --model {tmp_path / 'model.xml'}" in said.err


def without_priors(folder, to):
    shutil.copytree(folder, to)
    text = (to / "experiment.toml").read_text(encoding="utf-8")
    (to / "experiment.toml").write_text(text.partition("[known_to]")[0], encoding="utf-8")
    return to


@pytest.mark.slow
def test_an_effect_is_fitted_where_all_nominal_values_count_as_exact(dry, tmp_path):
    found = fitted(without_priors(dry, tmp_path / "arm"), effects=["joint_friction_of_one"]).fit
    assert found.shifts == ()
    assert found.sizes[1].value == pytest.approx(0.4, rel=0.05)
    assert np.isfinite([error.held_out for error in found.totals]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("--effects", "joint_fricton"),
            (
                "--effects: 'joint_fricton' is no effect of this mechanism; did you mean "
                "joint_friction?"
            ),
        ),
        (
            ("--parameters", "mass_relativ"),
            "--parameters: 'mass_relativ' is no value of [known_to]; did you mean mass_relative?",
        ),
        (
            ("--out", "model.toml"),
            "model.toml: the model of a mechanism is MJCF; name a file that ends with .xml",
        ),
        (("--phases", "free"), "--phases: is an option for recordings of a leg; leave it out here"),
    ],
)
def test_what_makes_no_sense_is_one_line(dry, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    answer = typed(monkeypatch, capsys, "fit", dry, *words)
    assert answer.exit_code == 2
    assert said in answer.err
    assert answer.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_nothing_to_fit_is_said(dry, tmp_path, monkeypatch, capsys):
    answer = typed(monkeypatch, capsys, "fit", without_priors(dry, tmp_path / "arm"))
    assert answer.exit_code == 2
    assert (
        "nothing to fit: [known_to] lists no value that these recordings depend on; name --effects"
        in answer.err
    )


def test_effects_are_for_mechanisms(monkeypatch, capsys):
    answer = typed(
        monkeypatch, capsys, "fit", "tests/data/small-campaign", "--effects", "joint_friction"
    )
    assert answer.exit_code == 2
    assert "--effects: is an option for recordings of a mechanism" in answer.err

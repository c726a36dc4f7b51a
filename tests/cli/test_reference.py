"""`diagnose --reference`: what has changed on a servo that another simulator moves."""

import json
from dataclasses import replace

import pytest

from tests.cli.test_eighty_columns import SMALL
from tests.cli.typed import typed
from tests.mechanism import servo as servos

KNOWN_TO = {
    "mass_relative": 0.01,
    "zero_offset_rad": 0.005,
    "command_gain_relative": 0.05,
    "joint_friction_Nm": 0.2,
    "torque_error_relative": 0.03,
}
FRICTION = servos.GearFriction(
    dry_Nm=0.15, rise=0.3, viscous_Nm_s_per_rad=0.05, driving_share=0.1, back_driving_share=0.05
)
BEFORE = servos.Servo(friction=FRICTION)
HEAVIER_KG = 0.2
AFTER = replace(BEFORE, weight_kg=BEFORE.weight_kg + HEAVIER_KG)


def record(folder, servo, repeats, seconds, supply):
    """The motions of a day, each as often as `repeats` says; names differ from day to day."""
    recordings = []
    for motion in ("lift and lower", "sines", "steps"):
        for repeat in range(repeats):
            factor = supply[len(recordings) % len(supply)]
            recording = servos.record(servo, motion, seconds, 5, factor)
            recordings.append(replace(recording, condition=f"{motion}, {folder.name} {repeat}"))
    model = servos.mjcf(replace(BEFORE, friction=servos.GearFriction()))
    return servos.write_campaign(folder, model, recordings, KNOWN_TO, folder.name)


@pytest.fixture
def say(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return lambda *words: typed(monkeypatch, capsys, *words)


@pytest.mark.slow
def test_a_heavier_weight_is_found_beside_a_model_that_lacks_friction(say, tmp_path):
    record(tmp_path / "before", BEFORE, 2, 6.3, (1.0, 1.01, 0.99))
    record(tmp_path / "after", AFTER, 1, 6.3, (1.005, 0.995))
    said = say("diagnose", "after", "--reference", "before", "--out", "out")
    assert said.exit_code == 0
    assert "Since the reference" in said.out
    assert "both recordings differ from the model by" in " ".join(said.out.split())
    answer = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [effect["id"] for effect in answer["effects"]] == ["added_mass"]
    mass = answer["effects"][0]["parameters"]["mass_kg"]
    assert mass["value"] == pytest.approx(HEAVIER_KG, abs=max(0.1 * HEAVIER_KG, 2.0 * mass["std"]))
    of_reference = answer["settings"]["reference"]
    assert of_reference["matched"] == of_reference["conditions"] == 9
    assert of_reference["repeats"] == 3
    assert "--reference before" in (tmp_path / "out" / "diagnosis.html").read_text(encoding="utf-8")


@pytest.fixture
def two_days(tmp_path):
    record(tmp_path / "before", BEFORE, 1, 1.5, (1.0,))
    record(tmp_path / "after", AFTER, 1, 1.5, (1.0,))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("after", "--reference", "after"), "--reference: 'after' is among the recordings"),
        (("after", "--reference", "before", "--each"), "leave out --each and --close-the-loop"),
        (("after", "--reference", "before", "--law", "joint"), "leave out --reference"),
        (("after", "--reference", "nowhere"), "nowhere"),
    ],
    ids=["itself", "each", "law", "nowhere"],
)
def test_what_does_not_go_together_is_refused_in_one_line(say, two_days, words, message):
    said = say("diagnose", *words)
    assert said.exit_code == 2
    assert message in " ".join(said.err.split())
    assert "Traceback" not in said.err


def test_other_signals_than_those_of_the_reference_are_refused(say, two_days):
    path = two_days / "before" / "experiment.toml"
    text = path.read_text(encoding="utf-8")
    speed = '[[signals]]\njoint = "joint"\nquantity = "speed"\ncolumn = "speed"\nunit = "rad/s"\n'
    path.write_text(text.replace("[[commands]]", f"{speed}\n[[commands]]"), encoding="utf-8")
    said = say("diagnose", "after", "--reference", "before")
    assert said.exit_code == 2
    assert "its signals are" in " ".join(said.err.split())


def test_a_leg_is_not_compared_with_a_mechanism(say, two_days):
    said = say("diagnose", SMALL, "--reference", "before")
    assert said.exit_code == 2
    assert "--reference: name recordings of the same leg" in " ".join(said.err.split())
    said = say("diagnose", "after", "--reference", SMALL)
    assert said.exit_code == 2
    assert "--reference: name recordings of the same mechanism" in " ".join(said.err.split())

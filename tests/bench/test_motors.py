"""Every motor that a rig file may name, from its file to a recorded stroke on the twin."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench import factory
from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.leg_plant import LegPlant
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput
from tests.engine.rigs import ROOT, nothing, one_condition, recorder_on

MIT = """
device = "cubemars-mit"
drive_id = 3
model = "AK10-9"
direction = -1
zero_rad = 0.5
"""

SERVO = """
device = "cubemars-servo"
drive_id = 104
gear_ratio = 9.0
pole_pairs = 21
torque_constant_Nm_per_A = 0.198
direction = -1
zero_deg = 20.0
status_period_ms = 2.0
"""


def written(folder: Path, motor: str) -> Path:
    """The shipped twin's file with another [motor] in it."""
    text = (ROOT / "calibration" / "twin.toml").read_text()
    before, rest = text.split("[motor]\n")
    after = rest[rest.index("[force_sensor]") :]
    file = folder / "rig.toml"
    file.write_text(f"{before}[motor]{motor}\n{after}")
    return file


def rig_with(folder: Path, motor: str) -> RigFile:
    return read_rig(written(folder, motor))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motor", "make", "rate_Hz"),
    [(MIT, "CubeMars AK, MIT mode", 500.0), (SERVO, "CubeMars AK, servo mode", 500.0)],
    ids=["mit", "servo"],
)
def test_a_plan_runs_on_the_twin_of_every_motor(
    tmp_path: Path, motor: str, make: str, rate_Hz: float
) -> None:
    rig = rig_with(tmp_path, motor)
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        assert bench.motor.identity()["make"] == make
        run_plan(one_condition(rig), bench, recorder, nothing)
    (stroke,) = recorder.strokes
    assert 1.0 / np.median(np.diff(stroke.streams["shaft"].t_s)) == pytest.approx(rate_Hz, rel=1e-6)
    assert rig.motor.reports_Hz == rate_Hz
    t_s, angle_rad = stroke.channel("shaft_angle_rad")
    assert np.interp(0.0, t_s, angle_rad) == pytest.approx(rig.leg.start_angle_rad, abs=0.01)
    assert np.interp(1.0, t_s, angle_rad) == pytest.approx(rig.leg.start_angle_rad + 3.249, abs=0.4)
    assert stroke.channel("fz_N")[1].min() == pytest.approx(-55.0, abs=8.0)


@pytest.mark.parametrize(
    ("motor", "said"),
    [
        (
            MIT + "node_id = 1\n",
            r"motor\.node_id: unknown key; known are direction, interface, .*model, zero_rad",
        ),
        (SERVO + "model = 'AK10-9'\n", r"motor\.model: unknown key; known are .*pole_pairs"),
        (
            SERVO.replace("zero_deg", "zero_degs"),
            r"motor\.zero_degs: unknown key; did you mean zero_deg\?",
        ),
        (
            MIT.replace("AK10-9", "AK99"),
            r"motor\.model: should be one of AK10-9, .*AK80-9-V2\.0, not 'AK99'",
        ),
        (
            MIT.replace("cubemars-mit", "cubemars"),
            r"motor: 'device' should be one of 'odrive', 'cubemars-mit', .*not 'cubemars'",
        ),
        (SERVO.replace("pole_pairs = 21", ""), r"motor\.pole_pairs: missing"),
        (
            MIT.replace("drive_id = 3", "drive_id = 127"),
            r"motor\.drive_id: should be less than or equal to 126, not 127",
        ),
        (
            MIT + "speed_gain_Nm_s_per_rad = 6.0\n",
            r"motor\.speed_gain_Nm_s_per_rad: should be less than or equal to 5",
        ),
    ],
)
def test_what_a_motor_does_not_have_is_refused_in_one_line(
    tmp_path: Path, motor: str, said: str
) -> None:
    with pytest.raises(BadInput, match=r"rig\.toml:\d+: " + said) as refused:
        rig_with(tmp_path, motor)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["calibration/twin", "tests/data/real-rig"])
def test_files_from_before_there_was_a_choice_are_still_read(name: str) -> None:
    assert read_rig(ROOT / f"{name}.toml").motor.device == "odrive"


@pytest.mark.parametrize("motor", [MIT, SERVO])
def test_the_twin_of_a_motor_is_opened_with_its_own_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, motor: str
) -> None:
    """The leg falls from where it is parked, and the motor holds it where it then hangs."""
    rig = rig_with(tmp_path, motor)
    plants = []
    monkeypatch.setattr(
        factory,
        "LegPlant",
        lambda *args, **named: plants.append(LegPlant(*args, **named)) or plants[-1],
    )
    with open_bench(rig, 1) as bench:
        bench.motor.enable()
        shaft = bench.motor.read()
        assert shaft.angle_rad[-1] == pytest.approx(plants[0].shaft().angle_rad, abs=0.01)
        assert shaft.angle_rad[-1] > np.radians(rig.rig.parked_angle_deg) + 0.1

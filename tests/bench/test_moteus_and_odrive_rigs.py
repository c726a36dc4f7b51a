"""Rig files with a moteus, and with an ODrive of either dialect: read, opened, and run through a
stroke on their twins.
"""

from pathlib import Path

import can
import numpy as np
import pytest

from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Recording
from tests.engine.rigs import ROOT, nothing, one_condition, recorder_on

MOTEUS = """
device = "moteus"
drive_id = 3
gear_ratio = 2.0
direction = -1
zero_turns = 0.125
"""
OLDER_ODRIVE = """
device = "odrive"
dialect = "0.5"
torque_constant_Nm_per_A = 0.0827
node_id = 4
gear_ratio = 9.0
direction = -1
zero_turns = 1.5
encoder_period_ms = 2.0
"""
NEWER_ODRIVE = OLDER_ODRIVE.replace('"0.5"\ntorque_constant_Nm_per_A = 0.0827', '"0.6"')
SPEED_rad_s = 2.433


def rig_with(folder: Path, motor: str) -> RigFile:
    """The shipped twin's file with another [motor] in it."""
    before, rest = (ROOT / "calibration" / "twin.toml").read_text().split("[motor]\n")
    file = folder / "rig.toml"
    file.write_text(f"{before}[motor]{motor}\n{rest[rest.index('[force_sensor]') :]}")
    return read_rig(file)


def run(folder: Path, motor: str) -> tuple[Recording, dict[str, str]]:
    rig = rig_with(folder, motor)
    with recorder_on(rig, folder / "run") as (bench, recorder, file):
        run_plan(one_condition(rig, speed_rad_s=SPEED_rad_s), bench, recorder, nothing)
        return file.finish(), bench.motor.identity()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motor", "named"),
    [
        (MOTEUS, {"drive_id": "3", "firmware": "1.3.4", "answers_lost": "0"}),
        (OLDER_ODRIVE, {"node_id": "4", "dialect": "0.5", "torque_from": "motor currents (0x14)"}),
        (NEWER_ODRIVE, {"node_id": "4", "dialect": "0.6", "torque_from": "torques (0x1C)"}),
    ],
)
def test_a_stroke_runs_and_its_time_is_the_drives(
    tmp_path: Path, motor: str, named: dict[str, str]
) -> None:
    recording, identity = run(tmp_path, motor)
    assert named.items() <= identity.items()
    stroke = recording.strokes[0]
    shaft_s, angle_rad = stroke.channel("shaft_angle_rad")
    assert np.diff(shaft_s) == pytest.approx(2e-3, rel=1e-6)
    free = (shaft_s > 0.1) & (
        shaft_s < 0.3
    )  # ramp of 0.05 s, then steady: angle = start + speed (t - 0.025 s)
    expected_rad = 0.246091 + SPEED_rad_s * (shaft_s[free] - 0.025)
    # 1 ms of time would be 2.4e-3. The leg, bent by gravity before it moves, shakes the shaft by up
    # to 6.6e-3.
    assert np.abs(angle_rad[free] - expected_rad).max() < 8e-3
    assert stroke.channel("fz_N")[1].min() == pytest.approx(-53.5, abs=1.5)


@pytest.mark.parametrize(
    ("motor", "said"),
    [
        (MOTEUS + "node_id = 1\n", r"motor\.node_id: unknown key"),
        (
            MOTEUS.replace("drive_id = 3", "drive_id = 0"),
            r"motor\.drive_id: should be greater than or equal to 1",
        ),
        (MOTEUS + "watchdog_ms = 0.0\n", r"motor\.watchdog_ms: should be greater than 0"),
        (
            OLDER_ODRIVE.replace("torque_constant_Nm_per_A = 0.0827\n", ""),
            r'motor: dialect "0\.5" needs torque_constant_Nm_per_A',
        ),
        (OLDER_ODRIVE.replace('"0.5"', '"0.4"'), r"motor\.dialect: should be '0\.5' or '0\.6'"),
        # The id of an ODrive that has none yet.
        (
            NEWER_ODRIVE.replace("node_id = 4", "node_id = 63"),
            r"motor\.node_id: should be less than or equal to 62",
        ),
    ],
)
def test_what_such_a_motor_cannot_be_is_refused_in_one_line(
    tmp_path: Path, motor: str, said: str
) -> None:
    with pytest.raises(BadInput, match=r"rig\.toml:\d+: " + said) as refused:
        rig_with(tmp_path, motor)
    assert "\n" not in str(refused.value)


def test_an_odrive_without_a_dialect_speaks_the_newer_one(tmp_path: Path) -> None:
    assert rig_with(tmp_path, NEWER_ODRIVE.replace('dialect = "0.6"\n', "")).motor.dialect == "0.6"


def test_a_bus_for_a_moteus_is_opened_for_can_fd_and_others_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []
    monkeypatch.setattr(can, "Bus", lambda **asked: opened.append(asked))
    for motor in (MOTEUS + 'channel = "can1"\n', NEWER_ODRIVE):
        rig_with(tmp_path, motor).motor.open()
    assert opened == [
        {
            "interface": "socketcan",
            "channel": "can1",
            "bitrate": 1_000_000,
            "data_bitrate": 5_000_000,
            "fd": True,
        },
        {"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000},
    ]

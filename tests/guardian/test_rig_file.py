"""Who gets a guardian: from the rig file to the bus that a run commands."""

from pathlib import Path

import pytest

from rfca_rig.bench.factory import make_motor, open_commanding_bus
from rfca_rig.clock import WallClock
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.errors import BadInput
from rfca_rig.guardian.guarded_bus import GuardedBus
from tests.guardian.rigs import CALIBRATION, SECTIONS, far_end

ODRIVE = (
    'device = "odrive"\nnode_id = 0\ngear_ratio = 9.0\ndirection = 1\nzero_turns = '
    "0.0\nencoder_period_ms = 2.0\n"
)
MOTEUS = 'device = "moteus"\ndrive_id = 1\ndirection = 1\nzero_turns = 0.0\n'


def rig_with(folder: Path, motor: str) -> RigFile:
    """A real rig whose CAN bus is where python-can's own configuration leads to."""
    before, rest = (CALIBRATION / "twin.toml").read_text().split("[motor]\n")
    after = rest[rest.index("[force_sensor]") :].partition("[twin]")[0]
    file = folder / "rig.toml"
    file.write_text(
        f'{before}[motor]\ninterface = "socketcand"\n{motor}\n{after}'.replace(
            'kind = "twin"', 'kind = "real"'
        )
    )
    return read_rig(file)


@pytest.mark.parametrize("motor", SECTIONS.values(), ids=SECTIONS)
def test_a_drive_without_a_watchdog_is_guarded_unless_the_file_says_no(tmp_path, motor):
    assert rig_with(tmp_path, motor).motor.is_guarded
    assert rig_with(tmp_path, motor + "guardian = true").motor.is_guarded
    assert not rig_with(tmp_path, motor + "guardian = false").motor.is_guarded


@pytest.mark.parametrize("motor", [ODRIVE, MOTEUS], ids=["odrive", "moteus"])
def test_a_drive_with_a_watchdog_is_not_and_cannot_be(tmp_path, motor):
    assert not rig_with(tmp_path, motor).motor.is_guarded
    with pytest.raises(
        BadInput, match=r"motor\.guardian: is for drives without a watchdog; this one has its own"
    ):
        rig_with(tmp_path, motor + "guardian = true")


@pytest.mark.parametrize(
    ("silence_ms", "said"),
    [("10.0", "greater than or equal to 20"), ("5000.0", "less than or equal to 300")],
)
def test_a_silence_that_trips_at_every_tick_or_never_is_refused(tmp_path, silence_ms, said):
    with pytest.raises(BadInput, match=rf"motor\.guardian_silence_ms: should be {said}"):
        rig_with(tmp_path, SECTIONS["mit"] + f"guardian_silence_ms = {silence_ms}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "guarded"),
    [
        ("guardian_silence_ms = 50.0", "disables the motor after 50 ms of silence"),
        ("guardian = false", "none"),
    ],
)
def test_the_bus_of_a_run_is_the_guardians_and_the_driver_knows_it(
    tmp_path, monkeypatch, more, guarded
):
    rig = rig_with(tmp_path, SECTIONS["mit"] + more)
    clock = WallClock()
    with far_end("mit") as served:
        monkeypatch.setenv("CAN_CONFIG", served.can_config)
        with open_commanding_bus(rig, clock) as bus:
            assert isinstance(bus, GuardedBus) == (guarded != "none")
            assert make_motor(rig, bus, clock).identity()["guardian"] == guarded

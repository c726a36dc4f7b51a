"""Every motor that the registry knows: a folder that is added is tested here without a further
line.
"""

import subprocess
import sys
from pathlib import Path

import pytest

import rfca_rig
from rfca_rig.contracts.own_devices import MotorOfAMake
from rfca_rig.devices import MOTORS, OWN, find_motor, load_object
from rfca_rig.devices.sections import MotorSection
from rfca_rig.toml import validate

KINDS = [kind for kind in MOTORS if kind != OWN]
PARTS = ("section", "driver", "twin", "faults", "check", "torque_off")


def example_of(kind: str) -> MotorSection:
    make = find_motor(kind)
    return validate({"device": kind, **make.example}, load_object(make.section), kind)


@pytest.mark.parametrize("kind", KINDS)
class TestEveryMotor(MotorOfAMake):
    """Driver and twin of each, with a gear, the other direction and a zero of its own where the
    drive has them.
    """

    @pytest.fixture(autouse=True)
    def _of_the_kind(self, kind: str) -> None:
        self.use(example_of(kind))


@pytest.mark.parametrize("kind", MOTORS)
def test_the_parts_that_a_make_names_exist(kind):
    make = find_motor(kind)
    assert all(load_object(place) for part in PARTS if (place := getattr(make, part)) is not None)
    assert issubclass(load_object(make.section), MotorSection)


@pytest.mark.parametrize("kind", KINDS)
def test_a_built_in_make_has_every_part(kind):
    make = find_motor(kind)
    assert None not in (make.driver, make.check, make.faults)
    assert make.example


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_has_its_own_watchdog_or_frames_that_a_guardian_sends(kind):
    make = find_motor(kind)
    assert load_object(make.section).needs_guardian == (make.torque_off is not None)


@pytest.mark.parametrize("kind", KINDS)
def test_faults_that_happen_once_have_an_event_and_the_others_none(kind):
    keys = example_of(kind)
    make = find_motor(kind)
    faults = load_object(make.faults)
    tests = TestEveryMotor()
    tests.keys = keys
    with tests.rig() as rig:
        events = faults.events(rig.twin)
    assert {fault.name for fault in faults.faults if fault.once} == {*events}


def test_a_rig_file_imports_no_driver_and_no_twin_of_a_motor():
    code = (
        "import rfca_rig.description.rig_file, sys; print(*(name for name in sys.modules if "
        "name.startswith('rfca_rig.devices.')))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(rfca_rig.__file__).parents[1],
    )
    assert not [
        name
        for name in loaded.stdout.split()
        if name.rpartition(".")[2] in {"driver", "twin", "checks", "codec"}
    ]

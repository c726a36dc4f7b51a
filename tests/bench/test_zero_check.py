"""The zero of a drive through power cycles, on twins that outlive the driver as a drive does."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from math import degrees, tau
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from rfca_rig.bench.factory import make_motor
from rfca_rig.bench.zero_check import (
    FRESH_S,
    UNFINISHED,
    EncoderReading,
    ZeroOfRun,
    find_doubt,
    new_check,
    read_check,
    read_encoder,
    read_still_encoder,
    state_file,
    write_check,
    zero_of,
)
from rfca_rig.bench.zero_setup import choose_zero, write_zero
from rfca_rig.clock import TWIN_START, Clock, TwinClock
from rfca_rig.contracts.motor_rig import Floats, MotorRig, Rotor, motor_rig
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices import find_motor
from rfca_rig.drivers.encoder_zero import EncoderZero
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.engine.interfaces import Bench
from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.toml import read_text
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.world import ShaftDrive

ROOT = Path(__file__).parents[2]

ODRIVE = """
device = "odrive"
node_id = 0
gear_ratio = 9.0
direction = -1
zero_turns = 2.75  # read on the first day
encoder_period_ms = 2.0
"""
OLD_ODRIVE = ODRIVE + 'dialect = "0.5"\ntorque_constant_Nm_per_A = 0.5\n'
MOTEUS = """
device = "moteus"
drive_id = 1
gear_ratio = 9.0
direction = -1
zero_turns = 2.75  # read on the first day
"""
MIT = """
device = "cubemars-mit"
drive_id = 1
model = "AK80-9"
direction = -1
zero_deg = 130.0  # read on the first day
"""
SERVO = """
device = "cubemars-servo"
drive_id = 1
gear_ratio = 9.0
pole_pairs = 21
torque_constant_Nm_per_A = 0.115
direction = -1
zero_deg = 130.0  # read on the first day
status_period_ms = 2.0
"""
OWN = f"""
device = "own"
file = "{ROOT}/docs/examples/our_motor.py"
twin_file = "{ROOT}/docs/examples/our_motor_twin.py"
direction = -1
gear_ratio = 9.0
zero_turns = 2.75  # read on the first day
report_period_ms = 2.0
node_id = 5
counts_per_turn = 16384.0
rated_torque_Nm = 1.2
"""
MAKES = {
    "odrive-0.6": ODRIVE,
    "odrive-0.5": OLD_ODRIVE,
    "moteus": MOTEUS,
    "cubemars-mit": MIT,
    "cubemars-servo": SERVO,
    "own": OWN,
}
POLICIES = ("behind-gear", "incremental")
# The leg hangs, and is held by hand, here. Neither is a place to which a power cycle could bring
# the reading by chance.
HANGING_RAD = 1.5
HELD_RAD = 0.02


def write_rig(folder: Path, motor: str, policy: str | None) -> Path:
    text = (ROOT / "calibration" / "twin.toml").read_text()
    head, _, rest = text.partition("[motor]")
    tail = rest[rest.index("[force_sensor]") :].partition("[twin]")[0]
    stated = f'zero_policy = "{policy}"\n' if policy else ""
    path = folder / "rig.toml"
    head = head.replace('kind = "twin"', 'kind = "real"')
    path.write_text(f"{head}[motor]{motor}{stated}\n{tail}")
    (folder / "twin-camera.toml").write_bytes(
        (ROOT / "calibration" / "twin-camera.toml").read_bytes()
    )
    return path


class HeldShaft(Rotor):
    """A shaft that only a hand moves."""

    def advance(
        self,
        to_s: float,
        drive: ShaftDrive,  # noqa: ARG002 (no torque turns it)
        force_times_s: Floats,
    ) -> Floats:
        self.now_s = to_s
        return np.zeros((len(force_times_s), 6))


@dataclass
class Lab:
    """A rig whose drive stays on while drivers come and go; `path` is its rig file."""

    path: Path
    rig: MotorRig

    def start_driver(self) -> tuple[RigFile, Bench]:
        """A new session, as the next command would begin it."""
        described = read_rig(self.path)
        clock: Clock = self.rig.clock
        motor = make_motor(described, self.rig.wire, clock)
        return described, Bench(motor, None, None, clock, is_real=True)  # type: ignore[arg-type]

    def turn_by_hand(self, angle_rad: float) -> None:
        self.rig.rotor.angle_rad = angle_rad

    def power_cycle(self) -> None:
        self.rig.twin.restart()
        self.rig.tick()

    def wait(self, seconds: float) -> None:
        """Time passes for the computer and for the drive."""
        self.rig.clock._now_s += seconds
        self.rig.rotor.now_s += seconds

    def check_zero(self, at_rad: float = HELD_RAD) -> None:
        """What `setup zero` does, with the leg held and then let down."""
        described, bench = self.start_driver()
        zero = zero_of(described)
        self.turn_by_hand(at_rad)
        held = read_encoder(bench.motor, bench.clock, zero, 0.1)
        chosen = choose_zero(zero, described.motor.zero_policy, held.value, at_rad)
        self.turn_by_hand(HANGING_RAD)
        left = read_encoder(bench.motor, bench.clock, zero, 0.1)
        text = write_zero(read_text(self.path), self.path, zero, chosen.value)
        write_atomically(self.path, text.encode())
        write_check(self.path, new_check(read_rig(self.path), held, left))

    def run(self, turned_rad: float = 0.0) -> tuple[dict[str, str], float]:
        """A run that leaves the shaft turned; what it records, and by how much its angle is wrong
        in degrees.
        """
        described, bench = self.start_driver()
        zero = ZeroOfRun(described, self.path)
        zero.check_before_arming()
        facts = zero.check_drive(bench)
        error_deg = degrees(self.read_angle(bench.motor) - self.rig.rotor.angle_rad)
        # Slowly, so that no driver takes it for a jump.
        for _ in range(200):
            self.rig.rotor.angle_rad += turned_rad / 200
            self.rig.tick()
            bench.motor.disable()
            bench.motor.read()
        zero.store_end(bench)
        return facts, error_deg

    def read_angle(self, motor: ShaftMotor) -> float:
        zero = zero_of(read_rig(self.path))
        return zero.angle_rad(read_encoder(motor, self.rig.clock, zero, 0.0).value)


@contextmanager
def lab(folder: Path, motor: str, policy: str | None) -> Iterator[Lab]:
    path = write_rig(folder, motor, policy)
    described = read_rig(path)
    make = find_motor(described.motor.device)
    rotor = HeldShaft(angle_rad=HANGING_RAD)
    with motor_rig(
        lambda bus, clock: make_motor(described, bus, clock),
        lambda bus: make.make_twin(described.motor, bus, LoopGains(), None),
        rotor,
    ) as rig:
        yield Lab(path, rig)


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("make", MAKES)
def test_a_run_after_a_power_cycle_is_refused_until_the_zero_is_checked(tmp_path, make, policy):
    with lab(tmp_path, MAKES[make], policy) as rig:
        rig.check_zero()
        facts, error_deg = rig.run(turned_rad=0.01)
        assert abs(error_deg) < 0.2
        assert facts["zero_policy"] == policy
        rig.power_cycle()
        with pytest.raises(BadInput) as refused:
            rig.run()
        assert "\n" not in str(refused.value)
        assert f"rfca-rig setup zero --rig {rig.path}" in str(refused.value)
        rig.check_zero()
        _, error_deg = rig.run()
        # A hand that held the leg exactly: what is left is the resolution of the reading.
        assert abs(error_deg) < 0.2


@pytest.mark.parametrize("make", MAKES)
def test_without_the_check_a_power_cycle_would_turn_the_angles_by_motor_turns(tmp_path, make):
    """What is guarded against: 40 degrees for each turn of the motor behind a gear of 9."""
    with lab(tmp_path, MAKES[make], "behind-gear") as rig:
        described, bench = rig.start_driver()
        before_rad = rig.read_angle(bench.motor)
        rig.power_cycle()
        _, bench = rig.start_driver()
        jump_deg = degrees(rig.read_angle(bench.motor) - before_rad)
        motor_turn_deg = zero_of(described).shaft_deg(zero_of(described).per_motor_turn)
        assert motor_turn_deg == pytest.approx(40.0)
        assert abs(jump_deg) > 39.0
        assert abs(jump_deg / 40.0 - round(jump_deg / 40.0)) < 0.01


@pytest.mark.parametrize("policy", ["absolute", None])
@pytest.mark.parametrize("make", ["odrive-0.6", "moteus"])
def test_absolute_and_unstated_policies_ask_nothing(tmp_path, make, policy):
    with lab(tmp_path, MAKES[make], policy) as rig:
        facts, error_deg = rig.run()
        if policy == "absolute":
            rig.power_cycle()
            facts, error_deg = rig.run()
        assert abs(error_deg) < 0.2
        assert facts == {"zero_policy": policy or "not stated"}
        assert not state_file(rig.path).exists()


@pytest.mark.parametrize("make", MAKES)
def test_an_old_rig_file_of_a_twin_records_nothing_and_takes_no_time(tmp_path, make):
    with lab(tmp_path, MAKES[make], None) as rig:
        described, bench = rig.start_driver()
        zero = ZeroOfRun(described, rig.path)
        zero.check_before_arming()
        began_s = bench.clock.now_s()
        assert zero.check_drive(replace(bench, is_real=False)) == {}
        zero.store_end(bench)
        assert bench.clock.now_s() == began_s
        assert not state_file(rig.path).exists()


def test_a_moteus_tells_a_power_cycle_by_its_uptime_where_the_reading_does_not(tmp_path):
    """Its leg was moved by a whole motor turn while it was off: the reading is the one that was
    left.
    """
    with lab(tmp_path, MOTEUS, "behind-gear") as rig:
        rig.rig.twin._powered_s = -100.0
        rig.check_zero()
        rig.run()
        rig.wait(60.0)
        rig.power_cycle()
        left = read_check(rig.path)
        described, bench = rig.start_driver()
        zero = zero_of(described)
        now = read_encoder(bench.motor, bench.clock, zero, 0.0)
        rig.turn_by_hand(HANGING_RAD + (left.left_reading - now.value) * tau / zero.per_shaft_turn)
        with pytest.raises(BadInput, match=r"powered up \d+ s ago, after the check"):
            rig.run()


def test_a_moteus_that_stayed_on_may_be_turned_by_hand(tmp_path):
    with lab(tmp_path, MOTEUS, "behind-gear") as rig:
        rig.rig.twin._powered_s = -100.0
        rig.check_zero()
        rig.wait(FRESH_S + 60.0)
        rig.turn_by_hand(HANGING_RAD + 1.0)
        facts, error_deg = rig.run()
        assert abs(error_deg) < 0.2
        assert facts["zero_evidence"].startswith("the drive was on for")


def test_a_drive_of_a_lab_that_tells_its_uptime_may_be_turned_by_hand(tmp_path, monkeypatch):
    with lab(tmp_path, OWN, "incremental") as rig:
        _, bench = rig.start_driver()
        drive_class = type(bench.motor)
        hear = drive_class.hear

        def hear_with_uptime(self, message):
            report = hear(self, message)
            return report and replace(report, uptime_s=100.0 + rig.rig.clock.now_s())

        monkeypatch.setattr(drive_class, "hear", hear_with_uptime)
        rig.check_zero()
        rig.turn_by_hand(HANGING_RAD + 1.0)
        facts, error_deg = rig.run()
        assert abs(error_deg) < 0.2
        assert facts["zero_evidence"].startswith("the drive was on for")


def test_an_odrive_whose_leg_was_moved_is_asked_since_nothing_else_tells_a_power_cycle(tmp_path):
    with lab(tmp_path, ODRIVE, "incremental") as rig:
        rig.check_zero()
        rig.turn_by_hand(HANGING_RAD + 0.2)
        with pytest.raises(BadInput, match="11 deg of the shaft away"):
            rig.run()


def test_an_ak_drive_that_turned_past_the_end_of_its_position_is_asked(tmp_path):
    """12.5 rad in MIT mode: the next driver begins to count at the other end."""
    with lab(tmp_path, MIT, "behind-gear") as rig:
        rig.check_zero()
        for _ in range(3):
            _, error_deg = rig.run(turned_rad=5.0)
            assert abs(error_deg) < 0.2
        with pytest.raises(BadInput, match="deg of the shaft away"):
            rig.run()


def test_a_run_that_did_not_end_in_order_is_followed_by_a_check(tmp_path):
    with lab(tmp_path, ODRIVE, "incremental") as rig:
        rig.check_zero()
        described, bench = rig.start_driver()
        zero = ZeroOfRun(described, rig.path)
        zero.check_before_arming()
        zero.check_drive(bench)
        # The computer fails here.
        with pytest.raises(BadInput, match=UNFINISHED):
            rig.run()


def test_a_drive_that_restarts_in_a_run_is_asked_afterwards(tmp_path):
    """It reads the same as before by chance, and its driver knows better."""
    with lab(tmp_path, ODRIVE, "incremental") as rig:
        rig.check_zero()
        described, bench = rig.start_driver()
        zero = ZeroOfRun(described, rig.path)
        zero.check_before_arming()
        zero.check_drive(bench)
        rig.power_cycle()
        rig.read_angle(bench.motor)
        zero.store_end(bench)
        with pytest.raises(BadInput, match="position leapt"):
            rig.run()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("zero_turns = 2.75", "zero_turns = 2.5", "zero_turns is 2.5, and 2.75 was what was"),
        ("direction = -1", "direction = 1", "direction or gear_ratio changed"),
        ("gear_ratio = 9.0", "gear_ratio = 6.0", "direction or gear_ratio changed"),
        ('kind = "real"', 'kind = "twin"', r"another kind \(REAL\)"),
    ],
)
def test_a_check_of_another_rig_file_does_not_count(tmp_path, old, new, said):
    with lab(tmp_path, ODRIVE, "incremental") as rig:
        rig.check_zero()
        twin = (ROOT / "calibration" / "twin.toml").read_text()
        text = rig.path.read_text() + "\n[twin]" + twin.partition("[twin]")[2]
        rig.path.write_text(text.replace(old, new, 1))
        with pytest.raises(BadInput, match=said):
            rig.run()


def test_a_damaged_record_of_the_check_is_named(tmp_path):
    with lab(tmp_path, ODRIVE, "incremental") as rig:
        state_file(rig.path).write_text("{}")
        with pytest.raises(BadInput, match=r"rig\.zero\.json: is no record of a zero check"):
            rig.run()


def test_a_zero_that_was_never_checked_is_refused_before_the_rig_is_armed(tmp_path):
    path = write_rig(tmp_path, ODRIVE, "incremental")
    with pytest.raises(
        BadInput, match=r"never checked; type rfca-rig setup zero --rig .*rig\.toml"
    ):
        ZeroOfRun(read_rig(path), path).check_before_arming()


TURNS = EncoderZero("zero_turns", 2.75, "turns", -9.0, 1.0)


@pytest.mark.parametrize(
    ("policy", "left", "now", "after_s", "is_asked"),
    [
        ("incremental", 5.0, 5.0, 1e6, False),
        ("incremental", 5.0, 5.13, 10.0, True),
        ("incremental", 0.1, 0.1, FRESH_S - 1.0, False),
        ("incremental", 0.1, 0.1, FRESH_S + 1.0, True),
        # A clock that was set back says nothing of how long ago it was.
        ("incremental", 0.1, 0.1, -5.0, True),
        ("behind-gear", -0.9, -0.9, FRESH_S + 1.0, True),
        ("behind-gear", -1.4, -1.4, FRESH_S + 1.0, False),
        ("behind-gear", 3.25, 0.25, 10.0, True),
    ],
)
def test_a_reading_excludes_a_power_up_only_where_none_would_put_it(
    tmp_path, policy, left, now, after_s, is_asked
):
    rig = read_rig(write_rig(tmp_path, ODRIVE, policy))
    began = EncoderReading(left, 0.0, 1, None, TWIN_START)
    check = new_check(rig, began, began)
    present = EncoderReading(now, 0.0, 1, None, TWIN_START + timedelta(seconds=after_s))
    assert (find_doubt(TURNS, policy, check, present) is not None) == is_asked


@pytest.mark.parametrize(
    ("uptime_s", "after_s", "uptime_now_s", "is_asked"),
    [
        (100.0, 3600.0, 3700.0, False),
        # Half a percent slow, as an oscillator without a crystal may be.
        (100.0, 3600.0, 3682.0, False),
        (100.0, 3600.0, 3600.0, True),
        (100.0, 3600.0, 5.0, True),
        # Off and on again in the first second: not told by uptime, but by the reading.
        (1.0, 3600.0, 3600.0, True),
    ],
)
def test_an_uptime_tells_a_power_up_whatever_the_reading(
    tmp_path, uptime_s, after_s, uptime_now_s, is_asked
):
    rig = read_rig(write_rig(tmp_path, MOTEUS, "behind-gear"))
    began = EncoderReading(3.25, 0.0, 1, uptime_s, TWIN_START)
    check = new_check(rig, began, began)
    at = TWIN_START + timedelta(seconds=after_s)
    present = EncoderReading(7.0, 0.0, 1, uptime_now_s, at)
    assert (find_doubt(TURNS, "behind-gear", check, present) is not None) == is_asked


class SwingingMotor:
    """A motor without torque whose leg swings about 90 degrees, and loses a factor of e in
    `decays_s`.
    """

    def __init__(self, clock: TwinClock, decays_s: float) -> None:
        self._clock = clock
        self._decays_s = decays_s

    def disable(self) -> None:
        pass

    def status(self) -> Mock:
        return Mock(uptime_s=None, zero_lost=None)

    def read(self) -> Mock:
        now_s = self._clock.now_s()
        swing_deg = 40.0 * np.exp(-now_s / self._decays_s) * np.cos(8.0 * now_s)
        return Mock(angle_rad=np.radians([90.0 + swing_deg]))


@pytest.mark.parametrize(("decays_s", "is_still"), [(1.0, True), (1e6, False)])
def test_a_leg_that_swings_is_read_when_it_stands_still(tmp_path, decays_s, is_still):
    clock = TwinClock()
    zero = read_rig(write_rig(tmp_path, ODRIVE, "incremental")).motor.encoder_zero
    reading = read_still_encoder(SwingingMotor(clock, decays_s), clock, zero)
    assert (zero.shaft_deg(reading.spread) <= 0.5) == is_still
    if is_still:
        assert degrees(zero.angle_rad(reading.value)) == pytest.approx(90.0, abs=1.0)
        assert 3.0 < clock.now_s() < 10.0
    else:
        assert clock.now_s() == pytest.approx(15.0, abs=0.5)

"""The zero that a held leg gives, and how it comes into the rig file."""

from math import radians

import pytest

from rfca_rig.bench.zero_check import EncoderReading
from rfca_rig.bench.zero_setup import (
    choose_zero,
    judge_direction,
    judge_quarter_turn,
    judge_stated_angle,
    refuse_moving,
    write_zero,
)
from rfca_rig.clock import TWIN_START
from rfca_rig.description.rig_file import read_rig
from rfca_rig.drivers.encoder_zero import EncoderZero
from rfca_rig.errors import BadInput
from tests.bench.test_zero_check import MIT, ODRIVE, SERVO, write_rig

TURNS = EncoderZero("zero_turns", 2.75, "turns", -9.0, 1.0)


@pytest.mark.parametrize("motor_turns", [-3, 0, 4])
@pytest.mark.parametrize("hand_deg", [-8.0, 0.0, 8.0])
def test_behind_a_gear_the_hand_only_decides_the_turn_of_the_motor(motor_turns, hand_deg):
    """The leg is held 8 degrees off; the zero keeps its exactness."""
    held_rad = radians(25.0)
    true_zero = 2.75 + motor_turns
    reading = true_zero - 9.0 * (25.0 + hand_deg) / 360.0
    chosen = choose_zero(TURNS, "behind-gear", reading, held_rad)
    assert chosen.value == pytest.approx(true_zero, abs=1e-12)
    assert chosen.motor_turns == motor_turns
    assert chosen.rest_deg == pytest.approx(abs(hand_deg), abs=1e-9)


def test_between_two_turns_of_the_motor_the_hand_decides_nothing():
    reading = 2.75 - 9.0 * 15.0 / 360.0
    with pytest.raises(BadInput, match=r"15\.0 deg off .* a turn of the motor is 40\.0 deg"):
        choose_zero(TURNS, "behind-gear", reading, 0.0)
    assert choose_zero(TURNS, "behind-gear", reading, 0.0, is_remeasured=True).value == reading


@pytest.mark.parametrize(("motor_turns", "shown"), [(9, 0), (-20, -2), (5, -4)])
def test_whole_turns_of_the_shaft_are_no_error_of_the_zero(motor_turns, shown):
    chosen = choose_zero(TURNS, "behind-gear", 2.75 + motor_turns, 0.0)
    assert chosen.value == pytest.approx(2.75 + motor_turns)
    assert chosen.motor_turns == shown
    assert chosen.off_deg == pytest.approx(40.0 * abs(shown), abs=1e-9)


def test_a_gear_without_a_whole_ratio_keeps_no_zero():
    broken = EncoderZero("zero_turns", 2.75, "turns", 9.5, 1.0)
    with pytest.raises(BadInput, match=r"9\.5 turns per turn of the shaft"):
        choose_zero(broken, "behind-gear", 2.75, 0.0)
    assert choose_zero(broken, "incremental", 3.0, 0.0).value == 3.0


@pytest.mark.parametrize("policy", ["incremental", "absolute", None])
def test_without_a_gear_in_between_the_reading_is_the_zero(policy):
    chosen = choose_zero(TURNS, policy, -1.0, radians(90.0))
    assert TURNS.zero_at(-1.0, radians(90.0)) == chosen.value == pytest.approx(1.25)
    assert chosen.motor_turns is None


def test_a_moving_leg_is_refused():
    still = EncoderReading(0.0, 9.0 * 0.9 / 360.0, 100, None, TWIN_START)
    refuse_moving(TURNS, still)
    moving = EncoderReading(0.0, 9.0 * 3.2 / 360.0, 100, None, TWIN_START)
    with pytest.raises(BadInput, match=r"the leg moved by 3\.2 deg .*hold it still"):
        refuse_moving(TURNS, moving)


@pytest.mark.parametrize(
    ("motor", "value", "line"),
    [
        (ODRIVE, -0.25, "zero_turns = -0.25  # read on the first day"),
        (MIT, radians(-30.0), "zero_deg = -30.0  # read on the first day"),
        (MIT.replace("zero_deg = 130.0", "zero_rad = 2.0"), 1.5, "zero_rad = 1.5  # read on the"),
        (SERVO, 90.0, "zero_deg = 90.0  # read on the first day"),
    ],
)
def test_only_the_zero_changes_in_the_rig_file(tmp_path, motor, value, line):
    path = write_rig(tmp_path, motor, "incremental")
    before = path.read_text()
    zero = read_rig(path).motor.encoder_zero
    after = write_zero(before, path, zero, value)
    changed = [
        new for old, new in zip(before.splitlines(), after.splitlines(), strict=True) if old != new
    ]
    assert len(changed) == 1
    assert changed[0].startswith(line)
    path.write_text(after)
    assert read_rig(path).motor.encoder_zero.value == pytest.approx(value)


def test_each_check_by_hand_names_the_key_to_change():
    assert judge_stated_angle(1.0, 0.0, "zero_turns").is_right
    assert "zero_turns" in judge_stated_angle(40.0, 0.0, "zero_turns").line()
    assert judge_direction(0.0, 31.0, 1).is_right
    assert "set direction = -1" in judge_direction(0.0, -31.0, 1).line()
    with pytest.raises(BadInput, match=r"turn by 2\.0 deg"):
        judge_direction(0.0, 2.0, 1)
    assert judge_quarter_turn(-91.0, 9.0).is_right
    wrong = judge_quarter_turn(60.0, 9.0)
    assert not wrong.is_right
    assert "set gear_ratio = 6 " in wrong.line()
    assert "gear_ratio" not in judge_quarter_turn(60.0, None).line()

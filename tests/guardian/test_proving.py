"""What is made of a guardian that was starved once, and what a guardian can tell from a drive's
frames.
"""

from math import nan

import can
import pytest

from rfca_rig.devices.cubemars.codec import servo as cubemars_servo
from rfca_rig.devices.cubemars.codec.servo import Status
from rfca_rig.devices.cubemars.driver import MitTorqueOffFrames, ServoTorqueOffFrames
from rfca_rig.drivers.guard import (
    GuardianProof,
    GuardianTorqueOff,
    TorqueOffResult,
    arm,
    prove_guard,
)
from rfca_rig.errors import DeviceError
from tests.guardian.inside import reply
from tests.guardian.rigs import MIT, SERVO


class Told:
    """A guard that did what the test says, or raises it."""

    def __init__(self, did: TorqueOffResult | can.CanError | None) -> None:
        self._did = did

    def await_let_go(self, limit_s: float) -> TorqueOffResult | None:
        assert limit_s == 1.0
        return self._or_raised()

    def arm(self) -> None:
        self._or_raised()

    def describe(self) -> str:
        return "as told"

    def _or_raised(self) -> TorqueOffResult | None:
        if isinstance(self._did, can.CanError):
            raise self._did
        return self._did


def proof(
    did: TorqueOffResult | can.CanError | None, held_Nm: float = 1.0, answers: bool = True
) -> GuardianProof:
    return prove_guard(Told(did), held_Nm, 0.1, 1.0, answers)


@pytest.mark.parametrize(
    ("held_Nm", "answers", "seen"),
    [
        (1.0, True, "the 1.00 N m that the motor held were gone"),
        (-1.0, False, "the 1.00 N m that the motor held were gone"),
        (
            0.05,
            True,
            "the drive answered the guardian; the motor held nothing that could be seen to go",
        ),
        (
            0.05,
            False,
            "the bus took the guardian's frames; the motor held nothing that could be seen to go",
        ),
    ],
)
def test_a_drive_without_torque_is_proof_and_what_it_rests_on_is_kept(held_Nm, answers, seen):
    proven = proof(TorqueOffResult(0.102, 0.015, 3, 0.05), held_Nm, answers)
    assert proven.took_s == pytest.approx(0.117)
    assert proven.seen == seen


@pytest.mark.parametrize(
    ("did", "held_Nm", "answers", "said"),
    [
        (None, 1.0, True, r"guardian not proven: it did nothing within 1 s of silence"),
        (
            TorqueOffResult(0.102, 0.5, 0, nan),
            1.0,
            True,
            r"disabled the drive after 102 ms, and the drive has sent nothing since",
        ),
        (
            TorqueOffResult(0.102, 0.5, 9, 0.9),
            1.0,
            True,
            r"still shows 0\.90 N m; press the emergency stop",
        ),
        (
            TorqueOffResult(0.102, 0.5, 9, -0.9),
            -1.0,
            False,
            r"still shows -0\.90 N m; press the emergency stop",
        ),
        (
            TorqueOffResult(0.102, 0.5, 9, 0.9),
            0.0,
            True,
            r"still shows 0\.90 N m; press the emergency stop",
        ),
        (can.CanOperationError("cable pulled"), 1.0, True, r"guardian not proven: cable pulled"),
    ],
    ids=["nothing", "no answer", "holds", "holds the other way", "pulls again", "bus"],
)
def test_everything_else_is_refused_in_words(did, held_Nm, answers, said):
    with pytest.raises(DeviceError, match=said):
        proof(did, held_Nm, answers)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (GuardianTorqueOff("guardian let go after 101 ms of silence"), "^guardian let go"),
        (can.CanOperationError("cable pulled"), "not enabled: cable"),
    ],
)
def test_what_was_not_told_yet_is_told_before_the_drive_is_energised(error, said):
    with pytest.raises(DeviceError, match=said):
        arm(Told(error))


# -- the drive's frames
# --------------------------------------------------------------------------------------------------


def status(drive: int, current_A: float) -> can.Message:
    identifier, data = cubemars_servo.status(drive, Status(0, 0.0, current_A, 30, 0))
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=True)


def test_torque_is_read_off_the_reports_of_this_drive():
    assert MitTorqueOffFrames(MIT).torque_Nm(reply(3.0)) is None
    mine = reply(3.0)
    mine.data[0] = MIT.drive_id
    assert (
        abs(MitTorqueOffFrames(MIT).torque_Nm(mine)) > 3.0
    )  # an AK10-9 reads the code of an AK80-9 on its own scale
    assert ServoTorqueOffFrames(SERVO).torque_Nm(status(104, 2.0)) == pytest.approx(
        -2.0 * 9.0 * 0.198
    )
    assert ServoTorqueOffFrames(SERVO).torque_Nm(status(105, 2.0)) is None


@pytest.mark.parametrize(
    "word", [MitTorqueOffFrames(MIT), ServoTorqueOffFrames(SERVO)], ids=["mit", "servo"]
)
def test_nothing_else_on_the_bus_is_taken_for_a_report_and_nothing_upsets_it(word):
    own = [message.arbitration_id for message in word.frames()]
    for identifier in (0, 3, 104, 0x2968, 0x0368, *own):
        for length in range(9):
            for extended in (False, True):
                message = can.Message(
                    arbitration_id=identifier, data=bytes([3] * length), is_extended_id=extended
                )
                torque_Nm = word.torque_Nm(message)
                assert torque_Nm is None or (length >= 6 and identifier in {0, 3, 0x2968})
    assert [word.torque_Nm(message) for message in word.frames()] == [None] * len(own)

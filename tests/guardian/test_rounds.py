"""What a guardian lets pass, when it lets go, and what it says; round by round on a clock of the
test's own.
"""

import can
import pytest

from rfca_rig.guardian.link import (
    GuardianRecord,
    RecordKind,
    decode_result,
    encode,
    from_frame,
    split_records,
    to_frame,
)
from rfca_rig.guardian.process import MAX_DURATION_S, MIN_REPETITIONS, REPEAT_S
from rfca_rig.twins.wires import CanEnd
from tests.guardian.inside import EXIT, LAST_WORD, LIMP, command, inside, reply

ODD_FRAMES = [
    can.Message(timestamp=1.25, arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"\x00\xff"),
    can.Message(timestamp=1e9 + 0.123456, arbitration_id=0x7FF, is_extended_id=False, data=b""),
    can.Message(timestamp=3.0, arbitration_id=5, is_extended_id=False, is_remote_frame=True, dlc=6),
    can.Message(
        timestamp=4.0, arbitration_id=0x40, is_extended_id=False, is_error_frame=True, data=bytes(8)
    ),
    can.Message(
        timestamp=5.0,
        arbitration_id=9,
        is_fd=True,
        bitrate_switch=True,
        error_state_indicator=True,
        data=bytes(range(64)),
    ),
]


@pytest.mark.parametrize("message", ODD_FRAMES, ids=["extended", "empty", "remote", "error", "fd"])
def test_a_frame_is_the_same_after_the_link_time_stamp_and_all(message):
    sent = encode(from_frame(message, message.timestamp))
    (record,), size = split_records(sent + sent[:-1])
    assert size == len(sent)
    assert to_frame(record).equals(message, timestamp_delta=0.0, check_direction=False)


def test_frames_of_the_bus_reach_the_parent_in_order():
    with inside() as i:
        for number in range(300):
            i.drive.send(command(number))
        i.rounds(0.003)
        assert [
            int.from_bytes(to_frame(record).data, "big") for record in i.told(RecordKind.FRAME)
        ] == list(range(300))


# -- passing
# --------------------------------------------------------------------------------------------------


def test_what_could_move_the_drive_passes_only_once_it_is_armed():
    with inside() as i:
        i.command(1)
        i.rounds(0.01)
        assert i.heard() == []
        i.arm()
        i.command(2)
        i.rounds(0.001)
        assert i.heard() == [bytes(command(2).data)]


def test_what_lets_the_drive_go_passes_at_any_time_and_is_confirmed():
    with inside() as i:
        for message in LAST_WORD.frames():
            assert i.confirmed(message) == ""
        assert i.heard() == [LIMP, EXIT]


def test_nothing_else_can_be_sent_as_if_it_let_the_drive_go():
    with inside() as i:
        assert "no frame that lets the drive go" in i.confirmed(command(7))
        assert i.heard() == []


def test_the_drivers_own_last_word_ends_the_watch_until_it_arms_again():
    with inside() as i:
        i.arm()
        i.command(1)
        i.confirmed(LAST_WORD.frames()[-1])
        i.heard()
        i.command(2)
        i.rounds(1.0)
        assert i.heard() == []
        assert i.told(RecordKind.LET_GO) == []


def test_a_command_without_gains_alone_does_not_end_the_watch():
    with inside() as i:
        i.arm()
        i.confirmed(LAST_WORD.frames()[0])
        i.rounds(0.11)
        assert len(i.told(RecordKind.LET_GO)) == 1


# -- silence
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("every_s", [0.001, 0.09, 0.5, 2.0])
def test_it_never_lets_go_while_commands_come_even_where_it_gets_little_time_itself(every_s):
    """Commands of every 10 ms; a round only every so often, in which whatever came meanwhile is
    found.
    """
    with inside() as i:
        i.arm()
        due_s = 0.0
        for tick in range(1000):
            i.clock.wait_until(0.01 * tick)
            i.command(tick)
            if i.clock.now_s() >= due_s:
                i.guardian.round(i.clock.now_s())
                due_s = i.clock.now_s() + every_s
        assert i.told(RecordKind.LET_GO) == []
        assert LIMP not in i.heard()


def test_it_lets_go_after_the_silence_and_says_how_long_it_was():
    with inside() as i:
        i.arm()
        i.command(1)
        i.rounds(0.099)
        assert i.heard() == [bytes(command(1).data)]
        i.rounds(0.002)
        assert i.heard() == [LIMP, EXIT]
        assert i.told(RecordKind.LET_GO)[0].text in {
            "guardian let go after 100 ms of silence",
            "guardian let go after 101 ms of silence",
        }


def test_reading_and_asking_do_not_count_as_commands():
    with inside() as i:
        i.arm()
        for _ in range(60):
            i.drive.send(reply(1.0))
            i.confirmed(LAST_WORD.frames()[0])
            i.rounds(0.002)
        assert len(i.told(RecordKind.LET_GO)) == 1


def test_it_is_latched_until_it_is_armed_again():
    with inside() as i:
        i.arm()
        i.rounds(0.15 + MAX_DURATION_S)
        i.heard()
        for number in range(50):
            i.command(number)
            i.rounds(0.01)
        assert i.heard() == []
        assert len(i.told(RecordKind.LET_GO)) == 1
        i.arm(2)
        i.command(9)
        i.rounds(0.001)
        assert i.heard() == [bytes(command(9).data)]


def test_commands_that_lay_in_the_pipe_while_everything_stood_still_do_not_reach_the_drive():
    with inside() as i:
        i.arm()
        i.rounds(0.001)
        i.command(1)
        i.clock.wait_until(i.clock.now_s() + 1.0)
        i.guardian.round(i.clock.now_s())
        assert i.heard() == [LIMP, EXIT]


def test_a_flooded_bus_hides_no_silence():
    with inside() as i:
        i.arm()
        for _ in range(120):
            for _ in range(300):
                i.drive.send(reply(1.0))
            i.rounds(0.001)
        assert len(i.told(RecordKind.LET_GO)) == 1


def test_a_parent_that_reads_nothing_holds_nothing_up_and_finds_afterwards_what_happened():
    with inside() as i:
        i.arm()
        for _ in range(2000):
            for _ in range(10):
                i.drive.send(reply(1.0))
            i.rounds(0.001)
        assert i.heard()[:2] == [LIMP, EXIT]
        i.told(RecordKind.LET_GO)
        i.rounds(0.05)
        assert len(i.told(RecordKind.LET_GO)) == len(i.told(RecordKind.SILENCED)) == 1
        assert 0 < len(i.told(RecordKind.FRAME)) < 20_000


# -- the last word
# --------------------------------------------------------------------------------------------------


def test_it_is_repeated_until_the_drive_shows_no_torque():
    with inside() as i:
        i.arm()
        i.rounds(0.101)
        for torque_Nm in (3.0, 2.0, 1.0, 0.5, 0.001, 0.001):
            i.drive.send(reply(torque_Nm))
            i.rounds(REPEAT_S)
        assert i.heard() == [LIMP, EXIT] * 5
        did = decode_result(i.told(RecordKind.SILENCED)[0])
        assert did.silent_s == pytest.approx(0.1, abs=1.1e-3)
        assert did.took_s == pytest.approx(4 * REPEAT_S, abs=2.1e-3)
        assert abs(did.torque_Nm) < 0.01


def test_a_report_that_was_on_its_way_is_no_proof():
    with inside() as i:
        i.arm()
        i.rounds(0.101)
        for _ in range(100):
            i.drive.send(reply(0.0))
            i.rounds(0.001)
        assert i.heard() == [LIMP, EXIT] * MIN_REPETITIONS


@pytest.mark.parametrize("torque_Nm", [None, 3.0], ids=["silent", "still pulling"])
def test_a_drive_that_does_not_show_it_is_told_for_a_while_and_then_reported_so(torque_Nm):
    with inside() as i:
        i.arm()
        for _ in range(700):
            if torque_Nm is not None:
                i.drive.send(reply(torque_Nm))
            i.rounds(0.001)
        assert len(i.heard()) == pytest.approx(2 * MAX_DURATION_S / REPEAT_S, abs=4)
        did = decode_result(i.told(RecordKind.SILENCED)[0])
        assert did.took_s == pytest.approx(MAX_DURATION_S, abs=0.01)
        assert (did.reports == 0) == (torque_Nm is None)


def test_arming_again_ends_the_repeating():
    with inside() as i:
        i.arm()
        i.rounds(0.103)
        i.arm(2)
        i.heard()
        i.rounds(0.05)
        assert i.heard() == []


class Faulty(CanEnd):
    """A bus that refuses some frames, and later maybe no more."""

    def __init__(self, refused, also_deaf: bool = False) -> None:
        super().__init__("faulty", [])
        self.refused = refused
        self.also_deaf = also_deaf
        self.tried: list[bytes] = []
        self.taken: list[bytes] = []

    def send(self, msg, timeout=None):  # noqa: ARG002 (never waits)
        self.tried.append(bytes(msg.data))
        if self.refused(bytes(msg.data)):
            raise ValueError("no such device")  # python-can's interfaces raise all sorts
        self.taken.append(bytes(msg.data))

    def _recv_internal(self, timeout):  # noqa: ARG002 (never waits)
        if self.also_deaf:
            raise can.CanOperationError("cable pulled")
        return None, False


def test_a_refused_frame_does_not_keep_the_next_one_back():
    bus = Faulty(lambda data: data == LIMP)
    with inside(bus) as i:
        i.arm()
        i.rounds(0.101)
        assert bus.taken == [EXIT]


def test_it_goes_on_until_the_bus_takes_it():
    bus = Faulty(lambda _: True)
    with inside(bus) as i:
        i.arm()
        i.rounds(2.0)
        assert i.told(RecordKind.SILENCED) == []
        assert (
            "last word was not taken: ValueError: no such device"
            in i.told(RecordKind.BUS_ERROR)[-1].text
        )
        bus.refused = lambda _: False
        i.rounds(0.02)
        assert bus.taken[:2] == [LIMP, EXIT]
        assert len(bus.taken) <= 2 * MIN_REPETITIONS


# -- errors of the bus, ends
# --------------------------------------------------------------------------------------------------


def test_a_frame_that_the_bus_refuses_is_told():
    with inside(Faulty(lambda _: True)) as i:
        i.arm()
        i.command(1)
        i.rounds(0.001)
        assert i.told(RecordKind.BUS_ERROR)[0].text == "no such device"
        assert i.confirmed(LAST_WORD.frames()[1]) == "no such device"


def test_a_last_word_of_the_driver_that_was_refused_leaves_the_watch_on():
    bus = Faulty(lambda _: True)
    with inside(bus) as i:
        i.arm()
        i.confirmed(LAST_WORD.frames()[1])
        bus.refused = lambda _: False
        i.rounds(0.101)
        assert bus.taken[:2] == [LIMP, EXIT]


def test_a_bus_that_cannot_be_read_is_told_again_and_again_and_is_still_sent_to():
    bus = Faulty(lambda _: False, also_deaf=True)
    with inside(bus) as i:
        i.arm()
        i.rounds(0.2)
        assert 3 < len(i.told(RecordKind.BUS_ERROR)) < 15
        assert {record.text for record in i.told(RecordKind.BUS_ERROR)} == {"cable pulled"}
        assert bus.taken[:2] == [LIMP, EXIT]


@pytest.mark.parametrize(
    ("signal", "close", "said"),
    [
        ("SIGTERM", False, "because it was ended by SIGTERM"),
        ("", False, "because the program that it guards ended"),
        ("", True, "because the program that it guards ended"),
    ],
    ids=["signal", "gone", "closed"],
)
def test_at_the_end_it_lets_go_of_a_drive_that_is_armed(signal, close, said):
    with inside() as i:
        i.arm()
        i.guardian.round(0.0)
        if close:
            i.put(GuardianRecord(RecordKind.CLOSE, 0.0))
        elif not signal:
            i.parent.close()
        i.guardian.run(lambda: signal)
        assert i.heard()[:2] == [LIMP, EXIT]
        if signal or close:
            assert said in i.told(RecordKind.LET_GO)[0].text


def test_at_the_end_it_says_nothing_to_a_drive_that_is_not_armed():
    with inside() as i:
        i.parent.close()
        i.guardian.run(lambda: "")
        assert i.heard() == []


def test_a_mistake_of_its_own_ends_it_with_the_last_word():
    with inside() as i:
        i.arm()
        i.guardian.round(0.0)
        i.guardian._show_life = None  # what should never happen
        with pytest.raises(TypeError):
            i.guardian.run(lambda: "")
        assert i.heard()[:2] == [LIMP, EXIT]
        assert "because of a mistake of its own (TypeError" in i.told(RecordKind.LET_GO)[0].text

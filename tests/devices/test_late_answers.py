"""Readings that are late from the very start, by a delay that never changes: a drive that
answers late is not enabled.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from unittest import mock

import can
import pytest

from rfca_rig.bench import factory
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import read_rig
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import DeviceError
from tests.engine.rigs import ROOT

GEAR = "gear_ratio = 9.0\ndirection = 1\nzero_turns = 0.0\n"
SECTIONS = {
    "odrive": f'device = "odrive"\nnode_id = 0\nencoder_period_ms = 2.0\n{GEAR}',
    "moteus": f'device = "moteus"\ndrive_id = 1\n{GEAR}',
}


class LateBus(can.BusABC):
    """The driver's end of a wire that holds every frame of the drive back for `late_s`, and may
    carry no remote frames.
    """

    def __init__(self, end: can.BusABC, clock: Clock, late_s: float, carries_remote: bool) -> None:
        super().__init__(channel="late")
        self.channel_info = "late"
        self._end = end
        self._clock = clock
        self.late_s = late_s
        self._carries_remote = carries_remote
        self._held: deque[tuple[float, can.Message]] = deque()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self._carries_remote or not msg.is_remote_frame:
            self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002 (time passes by the clock only)
        now_s = self._clock.now_s()
        while (message := self._end.recv(0)) is not None:
            self._held.append((now_s, message))
        is_due = bool(self._held) and now_s - self._held[0][0] >= self.late_s
        return (self._held.popleft()[1] if is_due else None), False


@contextmanager
def late_drive(
    folder, kind: str, late_s: float, carries_remote: bool = True
) -> Iterator[tuple[ShaftMotor, Clock, LateBus]]:
    before, rest = (
        (ROOT / "calibration" / "twin.toml").read_text(encoding="utf-8").split("[motor]\n")
    )
    file = folder / "rig.toml"
    file.write_text(
        f"{before}[motor]\n{SECTIONS[kind]}\n{rest[rest.index('[force_sensor]') :]}",
        encoding="utf-8",
    )
    buses: list[LateBus] = []
    make_motor = factory.make_motor

    def make_late_motor(rig, bus, clock) -> ShaftMotor:
        buses.append(LateBus(bus, clock, late_s, carries_remote))
        return make_motor(rig, buses[0], clock)

    with (
        mock.patch.object(factory, "make_motor", make_late_motor),
        factory.open_bench(read_rig(file), 1) as bench,
    ):
        yield bench.motor, bench.clock, buses[0]
        buses[0].shutdown()


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("late_ms", [122, 202, 402])
def test_a_drive_whose_frames_are_late_from_the_start_is_not_enabled(tmp_path, kind, late_ms):
    with late_drive(tmp_path, kind, 1e-3 * (late_ms - 2)) as (motor, _, _):
        with pytest.raises(DeviceError) as refused:
            motor.enable()
        assert (
            f"it answers {late_ms} ms after the question, 100 ms are the most, and its "
            "readings are as old"
        ) in str(refused.value)


@pytest.mark.parametrize("kind", SECTIONS)
def test_it_is_seen_at_a_later_start_too(tmp_path, kind):
    with late_drive(tmp_path, kind, 0.0) as (motor, clock, bus):
        motor.enable()
        motor.disable()
        bus.late_s = 0.2
        clock.wait_until(clock.now_s() + 0.5)
        motor.read()
        with pytest.raises(DeviceError, match=r"it answers 20. ms after the question"):
            motor.enable()


@pytest.mark.parametrize("kind", SECTIONS)
@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.08])
def test_delays_that_are_no_matter_are_taken(tmp_path, kind, late_s):
    with late_drive(tmp_path, kind, late_s) as (motor, _, _):
        motor.enable()


@pytest.mark.parametrize("kind", SECTIONS)
def test_one_late_answer_may_be_the_fault_of_this_computer(tmp_path, kind):
    with late_drive(tmp_path, kind, 0.15) as (motor, clock, bus):
        wait_until = clock.wait_until

        def recover(t_s: float) -> None:
            wait_until(t_s)
            # In time for the second answer.
            if t_s > 0.2:
                bus.late_s = 0.0

        with mock.patch.object(clock, "wait_until", recover):
            motor.enable()


def test_an_adapter_without_remote_frames_costs_half_a_second_once(tmp_path):
    with late_drive(tmp_path, "odrive", 0.0, carries_remote=False) as (motor, clock, _):
        starts_s = []
        for _ in range(2):
            began_s = clock.now_s()
            motor.enable()
            starts_s.append(clock.now_s() - began_s)
            motor.disable()
        assert starts_s[0] == pytest.approx(starts_s[1] + 0.4, abs=0.15)

"""Devices that are only listened to: on the twin of every make nothing is enabled or moved, and
nothing that a device sent is missing.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import can
import numpy as np
import pytest

from rfca_rig.bench import factory
from rfca_rig.bench.listening import open_listening_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.description.rig_file import read_devices, read_rig
from rfca_rig.devices.cubemars.codec.mit import Special, encode_special
from rfca_rig.devices.moteus import codec
from rfca_rig.devices.moteus.driver import STATE_QUERY
from rfca_rig.drivers.frame_tap import FrameTap
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.engine.listening import listen
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.recording.can_frames import SENT, can_form, frame_row, messages_in
from rfca_rig.recording.model import RawStage, Recording
from tests.bench.test_moteus_and_odrive_rigs import MOTEUS, NEWER_ODRIVE, OLDER_ODRIVE
from tests.bench.test_motors import MIT, SERVO, written
from tests.engine.rigs import Kept, twin_rig

MAKES = {
    "cubemars-mit": MIT,
    "cubemars-servo": SERVO,
    "moteus": MOTEUS,
    "odrive-0.5": OLDER_ODRIVE,
    "odrive-0.6": NEWER_ODRIVE,
}
# What a drive may be asked with; all others are sent nothing.
QUESTIONS = {
    "cubemars-mit": encode_special(Special.EXIT),
    "moteus": codec.encode(STATE_QUERY),
}


@dataclass
class Listened:
    """A recording, and the frames that passed at the twin's end of the bus."""

    recording: Recording
    received: list[can.Message] = field(default_factory=list)
    sent: list[can.Message] = field(default_factory=list)

    @property
    def stage(self) -> RawStage:
        (stage,) = self.recording.raw
        return stage


@contextmanager
def tapped_twin(monkeypatch) -> Iterator[list[FrameTap]]:
    """Puts a tap before the motor twin of whatever rig is opened."""
    taps = []
    make_twin = factory._make_motor_twin

    def make(rig, drive, bus, is_new):
        taps.append(FrameTap(bus, factory.TwinClock()))
        return make_twin(rig, drive, taps[-1], is_new)

    monkeypatch.setattr(factory, "_make_motor_twin", make)
    yield taps
    for tap in taps:
        tap.shutdown()


def begin(listening, recorder, tap) -> None:
    listening.begin(recorder)
    # Counted from here on at the twin's end, too.
    tap.take()


def nothing() -> None:
    """Nobody is told of the beginning."""


def listen_to(folder: Path, motor: str, monkeypatch, duration_s=1.0) -> Listened:
    rig = read_rig(written(folder, motor))
    kept = Kept(folder / "run", Recording("a run", "SIM", {}, {}, (), ()))
    with tapped_twin(monkeypatch) as taps, open_listening_bench(rig, 1) as listening:
        recorder = Recorder(kept.keeper, listening.bench.sensor.scale(), listening.bench.clock)
        listen(
            listening.bench,
            duration_s,
            lambda: begin(listening, recorder, taps[0]),
            lambda shaft, force: recorder.take_rows(listening.make_rows(shaft, force)),
        )
        recorder.end_listening("listening")
        frames = taps[0].take()
    return Listened(
        kept.finish(),
        [frame.message for frame in frames if not frame.is_sent],
        [frame.message for frame in frames if frame.is_sent],
    )


@pytest.mark.parametrize("make", MAKES)
def test_the_motor_is_never_enabled_moved_or_disabled_and_nothing_is_lost(
    tmp_path, make, monkeypatch
):
    listened = listen_to(tmp_path, MAKES[make], monkeypatch)
    # What the drive was sent: nothing, or the one question that it answers.
    assert {bytes(message.data) for message in listened.received} <= {QUESTIONS.get(make)}
    streams = listened.stage.streams
    frames = streams["can"].columns
    is_sent = (frames["flags"].data & SENT) > 0
    heard = [
        (int(identifier), int(length))
        for identifier, length in zip(
            frames["identifier"].data[~is_sent], frames["length"].data[~is_sent], strict=True
        )
    ]
    assert heard == [(message.arbitration_id, message.dlc) for message in listened.sent]
    assert is_sent.sum() == len(listened.received) + (make == "moteus")
    # Reports of the angle: one per period of the drive, or one per question but the last.
    expected = len(listened.received) if make in QUESTIONS else 500
    assert len(streams["shaft"].t_s) == pytest.approx(expected, abs=25)
    # The leg swings freely from where the twin begins.
    assert np.ptp(streams["shaft"].columns["shaft_angle_rad"].values) > 0.2
    assert np.abs(streams["shaft"].columns["motor_torque_Nm"].values).max() < 0.1
    numbers = streams["force"].columns["rdt_sequence"].data
    assert numbers.tolist() == list(range(1, len(numbers) + 1))
    assert len(numbers) == pytest.approx(7000, abs=40)


def test_every_report_of_a_drive_that_reports_by_itself_becomes_a_sample(tmp_path, monkeypatch):
    listened = listen_to(tmp_path, SERVO, monkeypatch)
    # Every frame of this drive is a status.
    assert len(listened.stage.streams["shaft"].t_s) == len(listened.sent)


def test_a_drive_in_mit_mode_is_not_asked_where_others_use_the_bus(tmp_path):
    """EXIT would disable a motor that another program runs."""
    foreign = can.Message(arbitration_id=0x123, data=b"\1\2", is_extended_id=False)
    frames = []
    with open_listening_bench(read_rig(written(tmp_path, MIT)), 1) as listening:
        # As if it came from another node.
        listening.tap._bus._arrived.append(foreign)
        listen(
            listening.bench,
            1.0,
            nothing,
            lambda shaft, force: frames.extend(listening.make_rows(shaft, force)[-1].tolist()),
        )
    assert [frame[0] for frame in frames] == [0x123]


def test_a_stop_request_ends_it_with_the_period(tmp_path):
    stop_request = StopRequest()
    calls = []

    def take(shaft, force):
        calls.append(len(force.counts))
        if len(calls) == 3:
            stop_request.ask(StopLevel.SAFE_POINT, "enough")

    with open_listening_bench(twin_rig(), 1) as listening:
        listen(listening.bench, 60.0, nothing, take, stop_request)
    assert len(calls) == 3


def test_the_sensor_is_stopped_whatever_happens(tmp_path):
    with open_listening_bench(twin_rig(), 1) as listening:

        def fail(shaft, force):
            raise DeviceError("broken")

        with pytest.raises(DeviceError, match="broken"):
            listen(listening.bench, 1.0, nothing, fail)
        clock = listening.bench.clock
        listening.bench.sensor.read()
        clock.wait_until(clock.now_s() + 0.1)
        assert len(listening.bench.sensor.read().counts) == 0


DEVICES = """
[rig]
title = "a bus"
kind = "real"

[motor]
interface = "virtual"
channel = "{channel}"
device = "odrive"
direction = 1
node_id = 4
gear_ratio = 1.0
zero_turns = 0.0
encoder_period_ms = 2.0
"""


def test_a_file_with_a_motor_alone_is_enough_and_frames_of_all_nodes_are_kept(tmp_path):
    file = tmp_path / "bus.toml"
    file.write_text(DEVICES.format(channel=tmp_path))
    sent = [
        can.Message(arbitration_id=0x7F1, data=b"\1\2\3", is_extended_id=False),
        can.Message(arbitration_id=0x18FF1234, data=b"", is_extended_id=True),
        can.Message(arbitration_id=0x85, is_remote_frame=True, dlc=4, is_extended_id=False),
        can.Message(arbitration_id=0x85, data=range(8), is_extended_id=False),
    ]
    rows = []
    with (
        open_listening_bench(read_devices(file), None) as listening,
        can.Bus(interface="virtual", channel=str(tmp_path)) as other,
    ):
        assert [form.name for form in listening.forms] == ["shaft", "can"]

        def send() -> None:
            for message in sent:
                other.send(message)

        listen(
            listening.bench,
            0.01,
            send,
            lambda shaft, force: rows.append(listening.make_rows(shaft, force)[-1]),
        )
        # The drive's own bus got nothing.
        assert other.recv(timeout=0) is None
    kept = list(messages_in(np.concatenate(rows), np.zeros(sum(map(len, rows)))))
    assert len(kept) == len(sent)
    for message, original in zip(kept, sent, strict=True):
        assert message.equals(original, timestamp_delta=None, check_channel=False)


def test_a_sensor_alone_is_enough(tmp_path):
    file = tmp_path / "sensor.toml"
    text = (Path(__file__).parents[2] / "calibration" / "twin.toml").read_text()
    sensor = text[text.index("[force_sensor]") :].partition("\n[")[0]
    file.write_text(f'[rig]\ntitle = "a sensor"\nkind = "real"\n{sensor}\n')
    assert read_devices(file).motor is None
    with open_listening_bench(read_devices(file), None) as listening:
        assert [form.name for form in listening.forms] == ["force"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[rig]\ntitle = "none"\nkind = "real"', "has neither [motor] nor [force_sensor]"),
        (DEVICES.replace('"real"', '"twin"'), "rig.kind: should be 'real'"),
        (DEVICES.replace("node_id", "node"), "motor.node: unknown key; did you mean node_id?"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, text, message):
    file = tmp_path / "bus.toml"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"bus\.toml") as error:
        read_devices(file)
    assert message in str(error.value)


@pytest.mark.parametrize("is_fd", [False, True])
def test_a_frame_comes_back_as_it_passed(is_fd):
    form = can_form(is_fd)
    message = can.Message(
        arbitration_id=0x1ABCDEF,
        data=bytes(range(64 if is_fd else 7)),
        is_fd=is_fd,
        bitrate_switch=is_fd,
        is_rx=False,
    )
    rows = np.frombuffer(frame_row(form, message, 1.5, is_sent=True), form.dtype)
    (back,) = messages_in(rows, np.array([1.5]))
    assert back.equals(message, timestamp_delta=None, check_channel=False)
    assert back.timestamp == 1.5

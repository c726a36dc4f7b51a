"""A force sensor read by a process of its own, over real sockets."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.acquisition.ring import Ring, RingReader
from rfca_rig.clock import WallClock
from rfca_rig.devices.netft.codec import RdtCommand, decode_request
from rfca_rig.devices.netft.driver import NetFtSensor, record_source
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.errors import DeviceError
from tests.acquisition.sender import datagram, sending

PATIENCE_S = 60.0


@pytest.fixture
def box():
    """The sensor's side, played by the test."""
    here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    here.bind(("127.0.0.1", 0))
    here.settimeout(PATIENCE_S)
    yield here
    here.close()


@pytest.fixture
def acquired(box):
    datagrams = AcquiredDatagrams(
        record_source("127.0.0.1", box.getsockname()[1]), WallClock(), ring_records=4096
    )
    yield datagrams
    datagrams.close()


def until(true) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.002)


def told(acquired, box) -> tuple[str, int]:
    """Where the box is to send to."""
    acquired.send(b"where are you")
    return box.recvfrom(100)[1]


@pytest.mark.realtime
@pytest.mark.parametrize("in_one", [1, 40])
def test_every_record_arrives_while_this_process_computes(in_one):
    """Pure Python that never pauses is what starves a reading thread."""
    clock = WallClock()
    with sending(14_000.0, in_one, 1.0) as (port, pipe):
        datagrams = AcquiredDatagrams(record_source("127.0.0.1", port), clock)
        sensor = NetFtSensor(datagrams, clock, NetFtSettings(rate_Hz=7000.0))
        sensor.start()
        numbers = []
        while not pipe.poll():
            sum(n * n for n in range(20_000))
            numbers += sensor.read().sequence.tolist()
        sent = pipe.recv()
        time.sleep(0.1)
        numbers += sensor.read().sequence.tolist()
        datagrams.close()
    assert sent > 10_000
    assert numbers == list(range(1, sent + 1))
    assert sensor.health().lost == sensor.health().malformed == datagrams.overrun == 0


def test_values_stay_with_their_records(acquired, box):
    client = told(acquired, box)
    sensor = NetFtSensor(acquired, WallClock(), NetFtSettings())
    sensor.start()
    assert [decode_request(box.recv(100)).command for _ in range(2)] == [
        RdtCommand.STOP,
        RdtCommand.START_BUFFERED,
    ]
    for first in (1, 2, 42):
        box.sendto(datagram(first, 40 if first == 2 else 1), client)
    seen = []
    until(lambda: seen.extend(sensor.read().counts.tolist()) or len(seen) == 42)
    assert seen == [[n] * 6 for n in range(1, 43)]


def test_a_datagram_of_a_wrong_length_is_counted_and_the_rest_goes_on(acquired, box):
    client = told(acquired, box)
    sensor = NetFtSensor(acquired, WallClock(), NetFtSettings())
    sensor.start()
    for sent in (datagram(1, 1), b"x" * 37, b"", datagram(2, 1), b"x" * 41 * 36, b"x" * 35):
        box.sendto(sent, client)
    seen = []
    until(
        lambda: (
            seen.extend(sensor.read().sequence.tolist())
            or (len(seen), sensor.health().malformed) == (2, 4)
        )
    )
    assert seen == [1, 2]
    assert "35 bytes" in " ".join(sensor.health().notes)


def test_the_receive_buffer_is_asked_for_and_read_back(acquired):
    plain = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    usual = plain.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    plain.close()
    assert acquired.receive_buffer_bytes > usual


def test_a_view_attached_by_name_sees_the_same_records_on_the_same_clock(box):
    clock = WallClock()
    acquired = AcquiredDatagrams(record_source("127.0.0.1", box.getsockname()[1]), clock)
    view = Ring.attach(acquired.ring_name)
    client = told(acquired, box)
    reader = RingReader(view)
    blocks = []
    before_s = clock.now_s()
    box.sendto(datagram(1, 40), client)
    until(lambda: blocks.append(reader.read()) or len(blocks[-1].records) == 40)
    assert blocks[-1].records.tobytes() == datagram(1, 40)
    assert before_s < blocks[-1].t_s[0] < clock.now_s()
    assert acquired.receive_all() == [datagram(1, 40)]
    view.close()
    acquired.close()


def test_a_box_that_is_not_there_is_said_so(box):
    port = box.getsockname()[1]
    acquired = AcquiredDatagrams(record_source("127.0.0.1", port), WallClock())
    box.close()

    def refused() -> bool:
        acquired.send(b"is anybody there")
        time.sleep(0.05)
        acquired.receive_all()
        return False

    with pytest.raises(DeviceError, match=r"is the sensor on|not sent"):
        until(refused)
    acquired.close()


def test_a_host_that_cannot_be_is_refused_and_nothing_is_left_running():
    with pytest.raises(DeviceError, match=r"no way to no\.such\.host\.invalid"):
        AcquiredDatagrams(record_source("no.such.host.invalid", 49152), WallClock())
    children = subprocess.run(
        ["ps", "--ppid", str(os.getpid()), "-o", "args="],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    assert "acquisition" not in children


def test_closing_ends_the_process_and_takes_the_ring_away(box):
    acquired = AcquiredDatagrams(record_source("127.0.0.1", box.getsockname()[1]), WallClock())
    process_id = acquired.process_id
    name = acquired.ring_name
    acquired.close()
    acquired.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process_id, 0)
    with pytest.raises(DeviceError):
        Ring.attach(name)


def test_a_process_that_was_killed_is_noticed(acquired):
    os.kill(acquired.process_id, signal.SIGKILL)

    def notices() -> bool:
        acquired.receive_all()
        return False

    with pytest.raises(DeviceError, match="ended by itself"):
        until(notices)


def test_an_interrupt_from_the_keyboard_is_left_to_the_parent(acquired, box):
    os.kill(acquired.process_id, signal.SIGINT)
    client = told(acquired, box)
    box.sendto(datagram(1, 1), client)
    until(lambda: acquired.receive_all() == [datagram(1, 1)])


ORPHAN = """
import os, time
from rfca_rig.acquisition.acquired import AcquiredDatagrams, RecordSource
from rfca_rig.clock import WallClock
acquired = AcquiredDatagrams(RecordSource("127.0.0.1", 9, 36, 40), WallClock())
print(acquired.process_id, flush=True)
time.sleep(60)
"""


def test_the_process_ends_when_its_parent_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(ORPHAN)
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as parent:
        child = int(parent.stdout.readline())
        parent.kill()
    until(lambda: not is_running(child))


def is_running(process_id: int) -> bool:
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    return True

"""A guardian on other adapters than a socketcand: a serial one, and python-can's bus over
multicast.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest

from rfca_rig.clock import WallClock
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import GuardianTorqueOff
from rfca_rig.guardian.guarded_bus import GuardedBus
from rfca_rig.guardian.process import signature
from tests.guardian.rigs import LAST_WORDS, SILENCE_S, far_end

WORD = LAST_WORDS["mit"]
COMMAND = can.Message(arbitration_id=3, data=bytes(8), is_extended_id=False)
GROUP = "239.74.163.2"


@contextmanager
def serial() -> Iterator[tuple[CanBusSettings, can.BusABC]]:
    with far_end("mit") as served, served.observer() as ear:
        yield CanBusSettings("slcan", str(served.server.ports["slcan"]), 1_000_000), ear


@contextmanager
def multicast() -> Iterator[tuple[CanBusSettings, can.BusABC]]:
    pytest.importorskip("msgpack", reason="python-can's multicast bus needs it")
    with can.Bus(interface="udp_multicast", channel=GROUP) as ear:
        yield CanBusSettings("udp_multicast", GROUP, 1_000_000), ear


def heard(ear: can.BusABC, seconds: float) -> list[can.Message]:
    until_s = time.monotonic() + seconds
    messages = []
    while (left_s := until_s - time.monotonic()) > 0.0:
        if (message := ear.recv(timeout=left_s)) is not None:
            messages.append(message)
    return messages


def wait_until_it_listens(bus: can.BusABC, ear: can.BusABC) -> None:
    """A serial adapter forwards nothing before it has read its open command, and it does not
    answer that command.
    """
    for _ in range(500):
        ear.send(can.Message(arbitration_id=0x18FE0000, is_extended_id=True))
        if any(message.is_extended_id for message in heard(bus, 0.02)):
            return
    raise AssertionError("the adapter forwarded nothing")


@pytest.mark.realtime
@pytest.mark.parametrize("adapter", [serial, multicast])
def test_commands_pass_and_their_end_is_the_end_of_the_torque(adapter):
    with adapter() as (settings, ear), GuardedBus(settings, WORD, SILENCE_S, WallClock()) as bus:
        bus.arm()
        for _ in range(50):
            bus.send(COMMAND)
            time.sleep(0.005)
        assert len([m for m in heard(ear, 0.05) if signature(m) == signature(COMMAND)]) == 50
        assert {signature(message) for message in WORD.frames()} <= {
            signature(message) for message in heard(ear, 0.5)
        }
        with pytest.raises(GuardianTorqueOff, match="guardian let go after 1"):
            bus.send(COMMAND)


@pytest.mark.realtime
@pytest.mark.parametrize("adapter", [serial, multicast])
def test_what_the_bus_says_arrives(adapter):
    with adapter() as (settings, ear), GuardedBus(settings, WORD, SILENCE_S, WallClock()) as bus:
        wait_until_it_listens(bus, ear)
        said = [
            can.Message(arbitration_id=0x18FF0000 + n, data=bytes([n]), is_extended_id=True)
            for n in range(50)
        ]
        for message in said:
            ear.send(message)
        there = [message for message in heard(bus, 0.5) if message.arbitration_id >> 16 == 0x18FF]
        assert [signature(message) for message in there] == [signature(message) for message in said]
        assert abs(there[0].timestamp - time.time()) < 5.0


def test_a_bus_over_tcp_sends_small_frames_at_once(monkeypatch) -> None:
    opened: list[dict[str, object]] = []
    monkeypatch.setattr("can.Bus", lambda **words: opened.append(words))
    for interface in ("socketcand", "socketcan"):
        CanBusSettings(interface, "can0", 1_000_000).open()
    assert [words.get("tcp_tune") for words in opened] == [os.name != "nt", None]

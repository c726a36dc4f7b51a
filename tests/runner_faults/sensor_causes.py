"""What goes wrong with the force sensor, and with what it feels."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rfca_rig.devices.netft.codec import decode_records, encode_records
from rfca_rig.errors import DeviceError
from tests.runner_faults.cause import GOES_ON, Cause, catalogued
from tests.runner_faults.rig import FaultyRig

BURST_S = 0.08


def _status(word: int) -> Callable[[FaultyRig], None]:
    def altered(datagrams: list[bytes]) -> list[bytes]:
        records = [decode_records(datagram) for datagram in datagrams]
        return [
            encode_records(replace(one, status=np.full_like(one.status, word))) for one in records
        ]

    def begin(rig: FaultyRig) -> None:
        rig.link.alter = altered

    return begin


def _lose_a_burst(rig: FaultyRig) -> None:
    until_s = rig.clock.now_s() + BURST_S
    rig.link.alter = lambda datagrams: [] if rig.clock.now_s() < until_s else datagrams


def _jump_on(rig: FaultyRig) -> None:
    """The records' own numbers leave out a tenth of a second, while the stream itself never
    stops.
    """
    gap = np.uint32(round(0.1 * rig.sensor.scale().rate_Hz))

    def altered(datagrams: list[bytes]) -> list[bytes]:
        records = [decode_records(datagram) for datagram in datagrams]
        return [
            encode_records(replace(one, rdt_sequence=one.rdt_sequence + gap)) for one in records
        ]

    rig.link.alter = altered


def _unplug(rig: FaultyRig) -> None:
    rig.link.error = DeviceError(
        "nothing to be received from 192.168.1.1: Network is unreachable; check the cable"
    )


def _pull(*wrench: float) -> Callable[[FaultyRig], None]:
    def begin(rig: FaultyRig) -> None:
        rig.truth.pull = np.array(wrench)

    return begin


SENSOR_CAUSES = (
    catalogued("force-silent", "sensor", "no record comes any more", "S-01", within_ms=60),
    catalogued("box-restart", "sensor", "the box restarts, its stream ends", "S-01", within_ms=60),
    catalogued(
        "stream-stolen", "sensor", "another client takes the stream over", "S-01", within_ms=60
    ),
    Cause(
        "records-lost",
        "sensor",
        "the records of 80 ms are lost, then they come again",
        "S-01",
        _lose_a_burst,
        within_ms=60,
    ),
    Cause(
        "records-jump",
        "sensor",
        "the records' numbers jump on by 0.1 s without a pause",
        "S-05",
        _jump_on,
    ),
    catalogued(
        "force-frozen",
        "sensor",
        "records run on, the sensor's sample counter and values stand still",
        "S-04",
        within_ms=215,
    ),
    catalogued(
        "force-stuck",
        "sensor",
        "records and both counters run on, the six values stand still",
        "S-04",
        within_ms=215,
    ),
    catalogued("force-saturated", "sensor", "the sensor says it is saturated", "S-02"),
    Cause(
        "force-error",
        "sensor",
        "the sensor says its analog board is broken",
        "S-03",
        _status(0x90000000),
    ),
    Cause(
        "network-gone",
        "sensor",
        "the network of the sensor is gone, reading raises",
        "S-06",
        _unplug,
    ),
    Cause(
        "over-force", "sensor", "the force goes above its limit", "L-01", _pull(0, 0, 400, 0, 0, 0)
    ),
    Cause(
        "over-moment", "sensor", "the moment goes above its limit", "L-02", _pull(0, 0, 0, 40, 0, 0)
    ),
    Cause(
        "force-lasts",
        "sensor",
        "three times the expected force, for longer than an impact",
        "L-03",
        _pull(0, 0, 200, 0, 0, 0),
        within_ms=115,
    ),
    Cause(
        "moment-lasts",
        "sensor",
        "three times the expected moment, for longer than an impact",
        "L-04",
        _pull(0, 0, 0, 20, 0, 0),
        within_ms=115,
    ),
    catalogued("force-twice", "sensor", "every tenth datagram comes twice", GOES_ON),
    catalogued("force-lost", "sensor", "every tenth datagram is lost", GOES_ON),
    Cause(
        "monitor-latched",
        "sensor",
        "the box has a monitor condition latched, a warning",
        GOES_ON,
        _status(0x80010000),
    ),
)

"""Reads the configuration of a Net F/T, and streams from it for half a second; never sends a bias."""

from collections.abc import Sequence

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.rdt import RdtCommand, Records, decode_records, encode_request
from rfca_rig.doctor.judging.netft import BoxObservation, StreamObservation
from rfca_rig.drivers.force_sensors.netft import NetFtBox
from rfca_rig.drivers.force_sensors.records import RecordSequence
from rfca_rig.drivers.ports import Datagrams, UdpDatagrams
from rfca_rig.drivers.roles import concatenate_blocks
from rfca_rig.errors import DeviceError

POLL_S = 2e-3
QUIET_S = 0.02
STREAM_S = 0.5


def look_at_box(host: str, box: NetFtBox) -> BoxObservation:
    try:
        return BoxObservation(host, box.says())
    except DeviceError as error:
        return BoxObservation(host, None, str(error))


def look_at_stream(host: str, port: int, buffered: bool, clock: Clock) -> StreamObservation:
    """Streams for half a second. It takes the stream from any other client, and ends it."""
    address = f"{host}:{port}"
    try:
        datagrams = UdpDatagrams(host, port)
    except DeviceError as error:
        return StreamObservation(address, 0.0, str(error))
    try:
        arrived = _stream(datagrams, buffered, clock)
    except DeviceError as error:
        return StreamObservation(address, STREAM_S, str(error))
    finally:
        datagrams.close()
    return observe_stream(address, STREAM_S, arrived)


def _stream(datagrams: Datagrams, buffered: bool, clock: Clock) -> list[bytes]:
    """Datagrams received in `STREAM_S`, without the remains of an earlier stream."""
    datagrams.send(encode_request(RdtCommand.STOP))
    clock.wait_until(clock.now_s() + QUIET_S)
    datagrams.receive_all()
    datagrams.send(encode_request(RdtCommand.START_BUFFERED if buffered else RdtCommand.START_SINGLE))
    arrived: list[bytes] = []
    until_s = clock.now_s() + STREAM_S
    # Also where reading fails: the box would stream to this address for ever.
    try:
        while clock.now_s() < until_s:
            clock.wait_until(clock.now_s() + POLL_S)
            arrived += datagrams.receive_all()
    finally:
        datagrams.send(encode_request(RdtCommand.STOP))
    return arrived


def observe_stream(address: str, seconds: float, datagrams: Sequence[bytes]) -> StreamObservation:
    """Evaluates the received datagrams."""
    blocks: list[Records] = []
    malformed = 0
    for datagram in datagrams:
        try:
            blocks.append(decode_records(datagram))
        except MalformedFrame:
            malformed += 1
    if not blocks:
        return StreamObservation(address, seconds, malformed=malformed)
    records, sequence = concatenate_blocks(blocks), RecordSequence()
    picked, numbers = sequence.take(records.rdt_sequence)
    # Only between neighbouring records: a lost one would look like a larger step.
    steps = np.diff(records.ft_sequence[picked]).view(np.int32)[np.diff(numbers) == 1]
    return StreamObservation(
        address=address,
        seconds=seconds,
        received=sequence.received,
        lost=sequence.lost,
        malformed=malformed,
        step=int(np.median(steps)) if len(steps) else None,
        words=tuple(np.unique(records.status).tolist()),
    )

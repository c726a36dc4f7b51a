"""An ATI Net F/T: its configuration, and half a second of its stream; never sends a bias. Also
the search for one without a rig file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs.force_sensors import (
    ERROR,
    MONITOR_LATCHED,
    SATURATED,
    WARNINGS,
    mark_axia_status,
    status_text,
)
from rfca_rig.devices.checks import (
    Finding,
    FoundSensor,
    green,
    judge_receive_buffer,
    probe_receive_buffer,
    red,
    yellow,
)
from rfca_rig.devices.netft.codec import (
    CalibrationInfo,
    NetFtConfiguration,
    RdtCommand,
    Records,
    decode_records,
    encode_request,
    start_command,
)
from rfca_rig.devices.netft.driver import (
    HttpBox,
    describe_settings,
    list_warnings,
    make_box,
    refuse_difference,
)
from rfca_rig.devices.netft.section import NetFtBox, NetFtConnection, NetFtSection, NetFtSettings
from rfca_rig.drivers.ports import RECEIVE_BUFFER_BYTES, Datagrams, UdpDatagrams
from rfca_rig.drivers.record_stream import RecordSequence
from rfca_rig.drivers.roles import concatenate_blocks
from rfca_rig.errors import DeviceError, MalformedFrame, RigError

BOX = "sensor's box"
STREAM = "sensor's records"
RATE = "sensor's rate"
STATUS = "sensor's status"
# Without bit 31, the summary error, which every error sets.
SATURATED_BIT = SATURATED & ~ERROR

SENSOR = "Net F/T"
# Factory address of a box, its record rate, and a short time limit, since usually none is there.
AS_DELIVERED = "192.168.1.1"
USUAL_RATE_Hz = 7000.0
SEARCH_S = 0.5

POLL_S = 2e-3
QUIET_S = 0.02
STREAM_S = 0.5


@dataclass(frozen=True)
class BoxObservation:
    """Observed box. `configuration` is what it is set to, None for the reason in `error`."""

    host: str
    configuration: NetFtConfiguration | CalibrationInfo | None = None
    error: str = ""


@dataclass(frozen=True)
class StreamObservation:
    """Observed short stream. `step` is the number of the sensor's own samples per record.

    `words` are the distinct status words. `error` is why the connection failed, None if it did not.
    """

    address: str
    seconds: float
    error: str | None = None
    received: int = 0
    lost: int = 0
    malformed: int = 0
    step: int | None = None
    words: tuple[int, ...] = ()


def judge_box(seen: BoxObservation, settings: NetFtSettings) -> Finding:
    if seen.configuration is None:
        return red(
            BOX, seen.error, _reach(seen.host), f"ping -c 3 {seen.host}", "ip -brief address"
        )
    try:
        refuse_difference(seen.configuration, settings, f"the box at {seen.host}")
    except RigError as difference:
        return red(
            BOX,
            str(difference),
            (
                f"change [force_sensor] in the rig file, or the box at http://{seen.host}/ "
                "under Configurations"
            ),
        )
    summary = (
        f"{_name(seen.configuration)}set as the rig file says ({settings.counts_per_N:g} "
        f"counts/N, {settings.rate_Hz:g} records/s){_other_settings(seen.configuration)}"
    )
    for warning in list_warnings(seen.configuration, settings):
        observed, _, fix = warning.partition("; ")
        return yellow(BOX, f"{summary}; {observed}", fix)
    return green(BOX, summary)


def _other_settings(configuration: NetFtConfiguration | CalibrationInfo) -> str:
    """Filter and tool transformation, after a semicolon."""
    if not isinstance(configuration, NetFtConfiguration):
        return "; its command interface tells neither filter nor tool transformation"
    names = {"low_pass": "filter", "tool_transformation": "tool transformation"}
    return "".join(
        f"; {names[name]} {text}" for name, text in describe_settings(configuration).items()
    )


def check_way(keys: NetFtSection, way: NetFtConnection) -> list[Finding]:
    """The finding on the box behind an open connection, none where its settings are not read."""
    if way.box is None:
        return []
    return [judge_box(look_at_box(keys.host, way.box), keys.settings())]


def judge_stream(
    seen: StreamObservation, settings: NetFtSettings, box_answers: bool | None
) -> list[Finding]:
    """Findings on the stream. `box_answers` is None if the box was not asked."""
    if not seen.received:
        return [_no_records(seen, box_answers)]
    return [_records(seen), _rate(seen, settings), _status(seen.words)]


def _name(configuration: NetFtConfiguration | CalibrationInfo) -> str:
    if isinstance(configuration, NetFtConfiguration):
        return f"{configuration.product} {configuration.serial_number}, "
    return ""


def _reach(host: str) -> str:
    return (
        "check the sensor's power and cable, host and ports under [force_sensor], and "
        "that this computer has an address in the network "
        f"of {host}:"
    )


def _no_records(seen: StreamObservation, box_answers: bool | None) -> Finding:
    host, _, port = seen.address.rpartition(":")
    if seen.malformed:
        return red(
            STREAM,
            f"{seen.malformed} datagrams from {seen.address}, none with records",
            "check port under [force_sensor]",
        )
    observed = f"none from {seen.address} in {seen.seconds:.1f} s"
    if seen.error is not None:
        observed += f": {seen.error}"
    # The box works, so the cause is the stream itself or the way of its datagrams.
    if box_answers and seen.error is None:
        fix = (
            "the box answers, so check that RDT is enabled on its Communications page, that "
            "nobody else took the stream, and the firewall:"
        )
        return red(STREAM, observed, fix, f"sudo ufw allow proto udp from {host}")
    if box_answers:
        return red(
            STREAM,
            observed,
            (
                f"the box answers, but not on UDP port {port}: correct port under "
                "[force_sensor], it is mostly 49152"
            ),
        )
    return red(STREAM, observed, _reach(host), f"ping -c 3 {host}", "ip -brief address")


def _records(seen: StreamObservation) -> Finding:
    observed = f"{seen.received} in {seen.seconds:.1f} s from {seen.address}"
    if seen.lost or seen.malformed:
        fix = (
            "see the receive buffer below; use a network port of its own for the sensor, "
            "without a switch that others load"
        )
        return yellow(STREAM, f"{observed}, {seen.lost} lost, {seen.malformed} malformed", fix)
    return green(STREAM, f"{observed}, none lost")


def _rate(seen: StreamObservation, settings: NetFtSettings) -> Finding:
    # Records arrive, but the box does not measure anything new.
    if not seen.step or seen.step < 0:
        fix = "switch the box's power off and on; if it stays, see its status page"
        return red(
            RATE, "the sensor's own sample counter stands still: the values are not new", fix
        )
    rate_Hz = settings.internal_rate_Hz / seen.step
    if seen.step == settings.decimation:
        return green(RATE, f"{rate_Hz:.6g} records/s")
    fix = (
        f"put rate_Hz = {rate_Hz:.6g} under [force_sensor], or set the RDT output rate on the "
        "box's Communications page"
    )
    return red(RATE, f"{rate_Hz:.6g} records/s, the rig file says {settings.rate_Hz:g}", fix)


def _status(status_words: tuple[int, ...]) -> Finding:
    faulty = [word for word in status_words if word not in WARNINGS]
    if any(word & SATURATED_BIT for word in faulty):
        fix = (
            "take every load off the sensor; if it stays, check the transducer's cable, then "
            "a gage is broken: have it looked at by ATI"
        )
        return red(STATUS, status_text(faulty[0]), fix)
    if faulty:
        return red(
            STATUS,
            status_text(faulty[0]),
            "switch the box's power off and on; if it stays, see its status page and the manual",
        )
    # A latched monitor condition is a warning only; the values are valid.
    if any(word & MONITOR_LATCHED for word in status_words):
        return yellow(
            STATUS,
            status_text(max(status_words)),
            "reset the latch on the box's Settings page; the values are good",
        )
    return green(STATUS, "healthy")


def look_at_box(host: str, box: NetFtBox) -> BoxObservation:
    try:
        return BoxObservation(host, box.read_configuration())
    except DeviceError as error:
        return BoxObservation(host, None, str(error))


def look_at_stream(
    host: str, port: int, buffered: bool, clock: Clock, is_axia: bool = False
) -> StreamObservation:
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
    return observe_stream(address, STREAM_S, arrived, is_axia)


def _stream(datagrams: Datagrams, buffered: bool, clock: Clock) -> list[bytes]:
    """Datagrams received in `STREAM_S`, without the remains of an earlier stream."""
    datagrams.send(encode_request(RdtCommand.STOP))
    clock.wait_until(clock.now_s() + QUIET_S)
    datagrams.receive_all()
    datagrams.send(encode_request(start_command(buffered)))
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


def observe_stream(
    address: str, seconds: float, datagrams: Sequence[bytes], is_axia: bool = False
) -> StreamObservation:
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
    records = concatenate_blocks(blocks)
    if is_axia:
        records = replace(records, status=mark_axia_status(records.status))
    sequence = RecordSequence()
    picked, numbers = sequence.take(records.rdt_sequence)
    # Only between neighbouring records: a lost one would look like a larger step.
    steps = np.diff(records.ft_sequence[picked]).view(np.int32)[np.diff(numbers) == 1]
    step = None
    if len(steps):
        step = int(np.median(steps))
    return StreamObservation(
        address=address,
        seconds=seconds,
        received=sequence.received,
        lost=sequence.lost,
        malformed=malformed,
        step=step,
        words=tuple(np.unique(records.status).tolist()),
    )


def check_sensor(keys: NetFtSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on box, stream and receive buffer. Streams for half a second."""
    settings = keys.settings()
    # Whether the box answers decides between two explanations of a missing stream.
    box = make_box(keys)
    answers = None
    if box is not None:
        seen = look_at_box(keys.host, box)
        answers = seen.configuration is not None
        yield judge_box(seen, settings)
    yield from judge_stream(
        look_at_stream(keys.host, keys.port, keys.buffered, clock, settings.is_axia),
        settings,
        answers,
    )
    yield judge_receive_buffer(probe_receive_buffer(), RECEIVE_BUFFER_BYTES, keys.rate_Hz)


def judge_found_sensor(seen: BoxObservation) -> Finding:
    if seen.configuration is None:
        fix = (
            "a sensor as delivered needs this computer in its network; with the right "
            "network port for eth0:"
        )
        return yellow(
            SENSOR,
            f"none at {seen.host}, where it is as delivered",
            fix,
            "sudo ip address add 192.168.1.100/24 dev eth0",
        )
    reply = seen.configuration
    if isinstance(reply, NetFtConfiguration):
        name = f"{reply.product} {reply.serial_number}"
    else:
        name = "a sensor"
    others = ""
    if isinstance(reply, NetFtConfiguration):
        if reply.is_axia:
            others += ', model = "axia"'
        others += _other_settings(reply)
    return green(
        SENSOR,
        (
            f"{name} at {seen.host}: counts_per_N = {reply.counts_per_N:.10g}, counts_per_Nm = "
            f"{reply.counts_per_Nm:.10g}{others}"
        ),
    )


def look_for_box() -> BoxObservation:
    """Asks for the configuration page of a Net F/T at its default address."""
    return look_at_box(AS_DELIVERED, HttpBox(AS_DELIVERED, timeout_s=SEARCH_S))


def find_sensor() -> FoundSensor:
    """Asks for a box at its default address."""
    seen = look_for_box()
    findings = (
        judge_found_sensor(seen),
        judge_receive_buffer(probe_receive_buffer(), RECEIVE_BUFFER_BYTES, USUAL_RATE_Hz),
    )
    if seen.configuration is None:
        return FoundSensor(findings)
    return FoundSensor(
        findings,
        f"Net F/T at {seen.host}",
        seen.host,
        (seen.configuration.counts_per_N, seen.configuration.counts_per_Nm),
    )

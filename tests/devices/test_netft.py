"""The Net F/T driver on its twin, over the bytes of the link."""

import socket
import struct
from collections.abc import Callable

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.force_sensor import ForceSensorContract, ForceSensorRig
from rfca_rig.devices.netft.codec import (
    RECORD_BYTES,
    RdtCommand,
    Records,
    decode_records,
    decode_request,
    encode_records,
    encode_request,
)
from rfca_rig.devices.netft.driver import NetFtSensor
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.drivers.ports import RECEIVE_BUFFER_BYTES, UdpDatagrams
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.wires import LinkEnd, datagram_link
from tests.devices.rig import Tampered, twin_rig

SECOND = 0.5


def records(
    first: int, count: int, ft_first: int | None = None, step: int = 1, status: int = 0
) -> bytes:
    """A datagram with numbers that tell where each record came from."""
    numbers = np.arange(first, first + count)
    ft = (first if ft_first is None else ft_first) + step * np.arange(count)
    words = [(column & 0xFFFFFFFF).astype(np.uint32) for column in (numbers, ft)]
    counts = np.outer(numbers & 0x7FFFFFFF, np.ones(6, np.int64)).astype(np.int32)
    return encode_records(Records(*words, np.full(count, status, np.uint32), counts))


def started(settings: NetFtSettings | None = None) -> tuple[NetFtSensor, LinkEnd, TwinClock]:
    """A driver whose other end the test plays itself."""
    clock = TwinClock()
    here, there = datagram_link()
    sensor = NetFtSensor(here, clock, settings or NetFtSettings())
    sensor.start()
    there.receive_all()
    return sensor, there, clock


def fed(*datagrams: bytes) -> tuple[NetFtSensor, list[int]]:
    """A driver that was given all of them in one read; and the numbers it handed over."""
    sensor, there, _ = started()
    for datagram in datagrams:
        there.send(datagram)
    return sensor, sensor.read().sequence.tolist()


def test_starting_asks_for_a_buffered_stream_without_end_and_sends_no_bias() -> None:
    here, there = datagram_link()
    NetFtSensor(here, TwinClock(), NetFtSettings()).start()
    requests = [decode_request(datagram) for datagram in there.receive_all()]
    assert [request.command for request in requests] == [RdtCommand.STOP, RdtCommand.START_BUFFERED]
    assert requests[-1].sample_count == 0


@pytest.mark.parametrize("decimation", [1, 7])
def test_every_record_arrives_once_on_the_sensors_own_clock(decimation: int) -> None:
    rate_Hz = 7000.0 / decimation
    settings = NetFtSettings(rate_Hz=rate_Hz)
    twin = NetFtTwinSettings(decimation=decimation)
    with twin_rig(sensor=settings, sensor_twin=twin) as rig:
        rig.sensor.start()
        _, force = rig.run(SECOND)
        assert len(force.sequence) >= rate_Hz * SECOND - 40
        assert force.sequence.tolist() == list(range(1, len(force.sequence) + 1))
        assert force.device_s == pytest.approx((force.sequence - 1) / rate_Hz)
        assert rig.sensor.scale().rate_Hz == pytest.approx(rate_Hz)
        assert rig.sensor.health().lost == rig.sensor.health().malformed == 0
        assert rig.sensor.health().notes == []


def test_counts_are_the_wrench_at_the_samples_own_time() -> None:
    with twin_rig() as rig:
        rig.sensor.start()
        _, force = rig.run(SECOND)
        ft = np.concatenate([decode_records(datagram).ft_sequence for datagram in rig.link.seen])
        wrench = np.sin(10.0 * np.pi * ft / 7000.0)[:, None] * np.arange(1.0, 7.0)
        assert np.abs(force.counts - 1e6 * wrench).max() <= 0.5001


def test_the_sensors_sample_counter_runs_on_over_a_new_start() -> None:
    with twin_rig() as rig:
        rig.sensor.start()
        rig.run(0.2)
        rig.sensor.stop()
        rig.run(0.1)
        rig.sensor.start()
        before = len(rig.link.seen)
        _, force = rig.run(0.2)
        assert force.sequence[0] == 1
        first = decode_records(rig.link.seen[before])
        assert first.ft_sequence[0] / 7000.0 == pytest.approx(rig.clock.now_s() - 0.2, abs=2e-3)
        assert rig.sensor.health().out_of_order == rig.sensor.health().duplicate == 0


def test_noise_has_the_given_spread_per_axis() -> None:
    std = (0.1, 0.2, 0.3, 0.01, 0.02, 0.0)
    with twin_rig(sensor_twin=NetFtTwinSettings(noise_std=std)) as rig:
        rig.rotor.swing = 0.0
        rig.sensor.start()
        _, force = rig.run(1.0)
        assert (force.counts / 1e6).std(axis=0) == pytest.approx(std, rel=0.05)


def test_forces_beyond_the_range_are_clipped_and_flagged() -> None:
    with twin_rig(
        sensor_twin=NetFtTwinSettings(full_scale=(330.0, 330.0, 2.0, 30.0, 30.0, 30.0))
    ) as rig:
        rig.sensor.start()
        _, force = rig.run(SECOND)
        assert force.counts[:, 2].max() == 2_000_000
        assert set(force.status.tolist()) == {0, 0x80020000}
        assert np.all((np.abs(force.counts[:, 2]) == 2_000_000) == (force.status != 0))
        assert rig.sensor.health().faulty_status == int((force.status != 0).sum())
        assert "transducer saturation" in rig.sensor.health().notes[0]


def test_a_latched_monitor_is_no_fault() -> None:
    sensor, _ = fed(records(1, 4, status=0x80010000))
    assert sensor.health().faulty_status == 0


def test_single_mode_sends_one_record_per_datagram_and_a_count_ends_the_stream() -> None:
    link, twin = _twin_alone()
    link.send(encode_request(RdtCommand.START_SINGLE, 5))
    _carry(twin, 0.01)
    datagrams = link.receive_all()
    assert [len(datagram) for datagram in datagrams] == [RECORD_BYTES] * 5
    assert [int(decode_records(datagram).rdt_sequence[0]) for datagram in datagrams] == [
        1,
        2,
        3,
        4,
        5,
    ]


def test_a_counted_buffered_stream_ends_with_a_short_datagram() -> None:
    link, twin = _twin_alone()
    link.send(encode_request(RdtCommand.START_BUFFERED, 50))
    _carry(twin, 0.1)
    assert [len(datagram) // RECORD_BYTES for datagram in link.receive_all()] == [40, 10]


def test_a_bias_takes_off_what_is_felt_now() -> None:
    link, twin = _twin_alone()
    link.send(encode_request(RdtCommand.START_BUFFERED))
    link.send(encode_request(RdtCommand.SET_BIAS))
    _carry(twin, 0.1, value=4.0)
    assert np.all(decode_records(link.receive_all()[-1]).counts == 0)


@pytest.mark.parametrize(("stops", "datagrams"), [(True, 0), (False, 17)])
def test_whether_a_bias_ends_the_stream_is_a_setting(stops: bool, datagrams: int) -> None:
    link, twin = _twin_alone(NetFtTwinSettings(bias_stops_stream=stops))
    link.send(encode_request(RdtCommand.START_BUFFERED))
    link.send(encode_request(RdtCommand.SET_BIAS))
    _carry(twin, 0.1)
    assert len(link.receive_all()) == datagrams


def test_the_twin_ignores_what_is_no_request() -> None:
    link, twin = _twin_alone()
    for junk in (b"", b"\x12\x34", bytes(8), bytes(14), encode_request(0x0099)):
        link.send(junk)
    _carry(twin, 0.1)
    assert link.receive_all() == []


def _twin_alone(settings: NetFtTwinSettings | None = None) -> tuple[LinkEnd, NetFtTwin]:
    here, there = datagram_link()
    return here, NetFtTwin(there, settings or NetFtTwinSettings(), np.random.default_rng(1))


def _carry(twin: NetFtTwin, to_s: float, value: float = 1.0) -> None:
    for end_s in np.arange(1, round(to_s / 1e-3) + 1) * 1e-3:
        twin.take_requests()
        twin.take_wrench(np.full((len(twin.due(end_s)), 6), value))


def test_a_lost_datagram_is_counted_and_time_goes_on_right() -> None:
    sensor, numbers = fed(records(1, 40), records(81, 40))
    assert numbers == [*range(1, 41), *range(81, 121)]
    assert (sensor.health().received, sensor.health().lost) == (80, 40)


def test_a_lost_datagram_between_reads_is_counted_too() -> None:
    sensor, there, _ = started()
    there.send(records(1, 40))
    sensor.read()
    there.send(records(81, 40))
    assert sensor.read().device_s[0] == pytest.approx(80 / 7000.0)
    assert sensor.health().lost == 40


def test_a_doubled_datagram_is_counted_and_handed_over_once() -> None:
    sensor, numbers = fed(records(1, 40), records(1, 40), records(41, 40))
    assert numbers == [*range(1, 81)]
    health = sensor.health()
    assert (health.received, health.duplicate, health.lost, health.out_of_order) == (80, 40, 0, 0)


def test_a_datagram_doubled_in_a_later_read_is_counted_and_not_handed_over() -> None:
    sensor, there, _ = started()
    there.send(records(1, 40))
    sensor.read()
    there.send(records(1, 40))
    assert len(sensor.read().sequence) == 0
    assert (sensor.health().duplicate, sensor.health().lost) == (40, 0)


def test_datagrams_that_overtook_each_other_are_put_in_order() -> None:
    sensor, numbers = fed(records(41, 40), records(1, 40), records(81, 40))
    assert numbers == [*range(1, 121)]
    health = sensor.health()
    assert (health.received, health.out_of_order, health.lost, health.duplicate) == (120, 40, 0, 0)


def test_values_stay_with_their_records_when_put_in_order() -> None:
    sensor, there, _ = started()
    for datagram in (records(41, 40), records(1, 40)):
        there.send(datagram)
    samples = sensor.read()
    assert samples.counts[:, 0].tolist() == samples.sequence.tolist()


def test_a_datagram_too_late_for_its_read_stays_lost_and_counts_no_billions() -> None:
    sensor, there, _ = started()
    there.send(records(41, 40))
    sensor.read()
    there.send(records(1, 40))
    there.send(records(81, 40))
    assert sensor.read().sequence.tolist() == [*range(81, 121)]
    health = sensor.health()
    assert (health.received, health.lost, health.out_of_order, health.duplicate) == (80, 40, 40, 0)


def test_a_late_datagram_that_comes_twice_is_late_once_and_then_a_duplicate() -> None:
    sensor, there, _ = started()
    for first in (41, 1, 1):
        there.send(records(first, 40))
        sensor.read()
    assert (sensor.health().out_of_order, sensor.health().duplicate, sensor.health().lost) == (
        40,
        40,
        40,
    )


@pytest.mark.parametrize("length", [0, 1, 35, 37, 1476])
def test_a_datagram_of_wrong_length_is_counted_and_thrown_away(length: int) -> None:
    sensor, numbers = fed(records(1, 3), bytes(length), records(4, 3))
    assert numbers == [1, 2, 3, 4, 5, 6]
    assert sensor.health().malformed == 1
    assert f"{length} bytes" in sensor.health().notes[0]


def test_the_counter_wraps_without_a_loss() -> None:
    sensor, there, _ = started()
    sensor._sequence._next = 2**32 - 20
    there.send(records(2**32 - 20, 40))
    there.send(records(20, 40))
    samples = sensor.read()
    assert np.all(np.diff(samples.sequence) == 1)
    assert samples.sequence[-1] == 2**32 + 59
    assert (sensor.health().lost, sensor.health().duplicate, sensor.health().out_of_order) == (
        0,
        0,
        0,
    )


def test_a_loss_across_the_wrap_counts_what_is_missing() -> None:
    sensor, there, _ = started()
    sensor._sequence._next = 2**32 - 20
    there.send(records(2**32 - 20, 10))
    there.send(records(10, 10))
    sensor.read()
    assert sensor.health().lost == 20


def test_a_sample_counter_that_stands_still_is_noted() -> None:
    sensor, _ = fed(records(1, 10), records(11, 10, ft_first=10, step=0))
    assert "stood still or ran back in 10 records" in sensor.health().notes[0]


def test_a_sample_counter_that_stands_still_from_read_to_read_is_noted() -> None:
    sensor, there, _ = started()
    for number in range(1, 6):
        there.send(records(number, 1, ft_first=77))
        sensor.read()
    assert "stood still or ran back in 4 records" in sensor.health().notes[0]


def test_a_sample_counter_that_wraps_is_no_stall() -> None:
    sensor, _ = fed(records(1, 10, ft_first=2**32 - 5), records(11, 10, ft_first=5))
    assert sensor.health().notes == []


def test_a_rate_other_than_configured_is_refused_with_both() -> None:
    with twin_rig(sensor_twin=NetFtTwinSettings(decimation=7)) as rig:
        rig.sensor.start()
        with pytest.raises(
            DeviceError, match=r"sends 1000 records/s, the settings say 7000.*comrdtrate"
        ):
            rig.run(0.1)


def test_a_sensor_that_falls_silent_shows_its_age() -> None:
    sensor, there, clock = started()
    there.send(records(1, 40))
    sensor.read()
    clock.wait_until(clock.now_s() + 0.25)
    assert len(sensor.read().sequence) == 0
    assert sensor.silent_s() == pytest.approx(0.25)
    assert "no record for 0.25 s" in sensor.health().notes[0]


def test_what_an_earlier_stream_left_on_the_way_does_not_reach_the_new_one() -> None:
    with twin_rig() as rig:
        rig.sensor.start()
        rig.run(0.1)
        rig.clock.wait_until(rig.clock.now_s() + 0.1)
        rig.sensor.start()
        _, force = rig.run(0.1)
        assert force.sequence[0] == 1
        assert rig.sensor.health().duplicate == rig.sensor.health().lost == 0


def test_duplicates_alone_are_silence() -> None:
    sensor, there, clock = started()
    there.send(records(1, 40))
    sensor.read()
    clock.wait_until(clock.now_s() + 0.25)
    there.send(records(1, 40))
    sensor.read()
    assert sensor.silent_s() == pytest.approx(0.25)


def test_stopping_may_be_repeated_and_ends_the_stream() -> None:
    with twin_rig() as rig:
        rig.sensor.start()
        rig.run(0.1)
        rig.sensor.stop()
        rig.sensor.stop()
        _, force = rig.run(0.1)
        assert len(force.sequence) == 0
        seen = len(rig.link.seen)
        rig.run(0.1)
        assert len(rig.link.seen) == seen


@pytest.mark.parametrize("rate_Hz", [6000.0, 9000.0])
def test_a_rate_the_box_cannot_do_is_refused_with_the_nearest(rate_Hz: float) -> None:
    with pytest.raises(BadInput, match=r"must be 7000/n; nearest 7000\.00"):
        NetFtSettings(rate_Hz=rate_Hz)


def test_a_rate_rounded_as_the_box_shows_it_is_taken_for_the_exact_one() -> None:
    settings = NetFtSettings(rate_Hz=152.17)
    assert settings.decimation == 46
    assert settings.record_period_s == 46 / 7000.0


@pytest.mark.parametrize("name", ["counts_per_N", "counts_per_Nm", "rate_Hz", "internal_rate_Hz"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_cannot_be_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(BadInput, match=f"force sensor: {name} is"):
        NetFtSettings(**{name: value})


def test_a_closed_link_is_an_error() -> None:
    here, _ = datagram_link()
    here.close()
    for act in (lambda: here.send(b""), here.receive_all):
        with pytest.raises(DeviceError, match="closed"):
            act()


def test_udp_carries_a_stream_and_asks_for_a_large_buffer() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(5.0)
        datagrams = UdpDatagrams("127.0.0.1", box.getsockname()[1])
        sensor = NetFtSensor(datagrams, TwinClock(), NetFtSettings())
        sensor.start()
        requests = [box.recvfrom(64) for _ in range(2)]
        assert [decode_request(data).command for data, _ in requests] == [0x0000, 0x0003]
        client = requests[-1][1]
        for first in range(1, 4001, 40):
            box.sendto(records(first, 40), client)
        assert sensor.read().sequence.tolist() == list(range(1, 4001))
        assert len(sensor.read().sequence) == 0
        assert 0 < datagrams.receive_buffer_bytes <= 2 * RECEIVE_BUFFER_BYTES
        datagrams.close()
        datagrams.close()
        with pytest.raises(DeviceError, match="not sent"):
            datagrams.send(b"")


def test_udp_tells_when_nobody_is_there() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    datagrams = UdpDatagrams("127.0.0.1", port)
    datagrams.send(b"hello")
    with pytest.raises(DeviceError, match=f"nothing to be received from 127.0.0.1:{port}"):
        datagrams.receive_all()
    datagrams.close()


def test_udp_to_a_host_that_cannot_be_is_an_error() -> None:
    with pytest.raises(DeviceError, match=r"no way to 300\.1\.1\.1:49152"):
        UdpDatagrams("300.1.1.1", 49152)


@pytest.mark.parametrize(
    "order", [lambda n: n, lambda n: n[::-1], lambda n: n * 2, lambda n: n[1::2]]
)
def test_received_and_lost_add_up_to_what_was_sent(
    order: Callable[[list[bytes]], list[bytes]],
) -> None:
    sensor, _ = fed(*order([struct.pack(">3I6i", n, n, 0, *[n] * 6) for n in range(1, 101)]))
    health = sensor.health()
    assert health.received + health.lost == 100


class TestNetFt(ForceSensorContract):
    """The contract over RDT: buffered at the box's full rate, buffered and decimated, and one
    record a datagram.
    """

    @pytest.fixture(
        params=[(1, True), (7, True), (7, False)],
        ids=["7000-buffered", "1000-buffered", "1000-single"],
    )
    def rig(self, request: pytest.FixtureRequest) -> ForceSensorRig:
        decimation, buffered = request.param
        clock = TwinClock()
        (here, there) = datagram_link()
        link = Tampered(here)
        rate_Hz = 7000.0 / decimation
        sensor = NetFtSensor(link, clock, NetFtSettings(rate_Hz=rate_Hz, buffered=buffered))
        return ForceSensorRig(
            clock=clock,
            sensor=sensor,
            twin=NetFtTwin(
                there, NetFtTwinSettings(decimation=decimation), np.random.default_rng(1)
            ),
            rate_Hz=rate_Hz,
            latency_s=40.0 / rate_Hz if buffered else 0.0,
            resolution=np.full(6, 0.5001e-6),
            saturating=(0.0, 0.0, 1200.0, 0.0, 0.0, 0.0),
            silence=_from_now(link, lambda _: []),
            lose=_once(link, lambda _: []),
            damage=_once(link, lambda first: [first[:-1]]),
            freeze=_from_now(link, lambda datagrams: [_frozen(datagram) for datagram in datagrams]),
            repeat=_once(link, lambda first: [first, first]),
            swap=_swapped(link),
        )


def _from_now(link: Tampered, change: Callable[[list[bytes]], list[bytes]]) -> Callable[[], None]:
    return lambda: setattr(link, "tamper", change)


def _once(link: Tampered, change: Callable[[bytes], list[bytes]]) -> Callable[[], None]:
    """Changes the next datagram."""

    def tamper(datagrams: list[bytes]) -> list[bytes]:
        if not datagrams:
            return []
        link.tamper = None
        return [*change(datagrams[0]), *datagrams[1:]]

    return lambda: setattr(link, "tamper", tamper)


def _swapped(link: Tampered) -> Callable[[], None]:
    """Holds the next datagram back until another has come, and lets that one pass it."""
    held: list[bytes] = []

    def tamper(datagrams: list[bytes]) -> list[bytes]:
        held.extend(datagrams)
        if len(held) < 2:
            return []
        link.tamper = None
        return [held[1], held[0], *held[2:]]

    return lambda: setattr(link, "tamper", tamper)


def _frozen(datagram: bytes) -> bytes:
    records = decode_records(datagram)
    return encode_records(
        Records(
            records.rdt_sequence,
            np.full_like(records.ft_sequence, 77),
            records.status,
            records.counts,
        )
    )

"""The driver of the ATI F/T Controller on its twin, over the bytes of the line."""

import os
import pty
import time
import tty

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.force_sensor import ForceSensorContract, ForceSensorRig, NoisyPort, constant
from rfca_rig.devices.ati_serial.codec import RecordForm
from rfca_rig.devices.ati_serial.driver import AtiSerialSensor
from rfca_rig.devices.ati_serial.section import AtiSerialSection
from rfca_rig.devices.ati_serial.twin import AtiSerialTwin, AtiSerialTwinSettings
from rfca_rig.drivers.ports import open_port
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.toml import validate
from rfca_rig.twins.wires import serial_line

RATES_HZ = {RecordForm.ASCII: 80.0, RecordForm.BINARY: 250.0, RecordForm.BINARY_CHECKSUM: 250.0}


def keys(
    counts_per_N: float = 20.0,
    counts_per_Nm: float = 1000.0 / 3.0,
    rate_Hz: float = 80.0,
    form: RecordForm = RecordForm.ASCII,
    **others: object,
) -> AtiSerialSection:
    values = {
        "counts_per_N": counts_per_N,
        "counts_per_Nm": counts_per_Nm,
        "rate_Hz": rate_Hz,
        "record": form.value,
        "port": "COM3",
    }
    return validate({"device": "ati-serial", **values, **others}, AtiSerialSection, "ati-serial")


def made(
    form: RecordForm, rate_Hz: float | None = None, twin: AtiSerialTwinSettings | None = None
) -> tuple[ForceSensorRig, NoisyPort]:
    rate_Hz = rate_Hz or RATES_HZ[form]
    twin_settings = twin or AtiSerialTwinSettings(sampling_Hz=rate_Hz)
    clock = TwinClock()
    (host, device) = serial_line()
    port = NoisyPort(host)
    sensor = AtiSerialSensor(
        port, clock, keys(twin_settings.counts_per_N, twin_settings.counts_per_Nm, rate_Hz, form)
    )
    rig = ForceSensorRig(
        clock=clock,
        sensor=sensor,
        twin=AtiSerialTwin(device, twin_settings, np.random.default_rng(1)),
        rate_Hz=rate_Hz,
        latency_s=0.01,
        resolution=0.5001 / np.repeat([twin_settings.counts_per_N, twin_settings.counts_per_Nm], 3),
        saturating=(0.0, 0.0, 300.0, 0.0, 0.0, 0.0),
        silence=lambda: setattr(port, "silent", True),
        lose=lambda: setattr(port, "drop", 20 * form.record_bytes),
        damage=lambda: setattr(port, "spoil", 5 * form.record_bytes + 3),
        freeze=lambda: setattr(rig, "wrench", constant(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
    )
    return rig, port


@pytest.mark.parametrize("form", list(RecordForm), ids=lambda form: form.value)
class TestAtiSerial(ForceSensorContract):
    @pytest.fixture
    def rig(self, form: RecordForm) -> ForceSensorRig:
        return made(form)[0]


def test_starting_sets_the_form_and_asks_for_a_stream_without_a_bias() -> None:
    rig, port = made(RecordForm.BINARY_CHECKSUM)
    sent = []
    port.write = lambda data: (sent.append(data), port.end.write(data))[1]
    rig.sensor.start()
    assert sent == [b"\r", b"CD R\r", b"CD E\r", b"CD B\r", b"QS\r"]


def test_a_controller_that_says_nothing_is_told_with_the_command() -> None:
    rig, port = made(RecordForm.ASCII)
    port.silent = True
    with pytest.raises(
        DeviceError,
        match=(
            r"COM3 gives no prompt to a carriage return within 0\.5 s, and sent nothing; "
            r".*38400 bit/s"
        ),
    ):
        rig.sensor.start()


def test_prompts_of_something_that_does_not_echo_are_not_believed() -> None:
    rig, port = made(RecordForm.ASCII)
    port.silent = True
    port.held = b">>>>>>>>"
    with pytest.raises(DeviceError, match=r"gives no prompt to 'CD R'"):
        rig.sensor.start()


@pytest.mark.parametrize("form", list(RecordForm))
def test_an_echo_that_comes_in_pieces_is_cut_off_whole(form: RecordForm) -> None:
    rig, port = made(form)
    rig.sensor.start()
    rig.clock.wait_until(rig.clock.now_s() + 0.05)
    port.most = 3
    assert len(rig.sensor.read().sequence) == 0
    port.most = 1 << 16
    samples = rig.run(0.5)
    assert np.abs(rig.in_units(samples)).max() < 4.0
    assert rig.sensor.health().malformed == rig.sensor.health().lost == 0
    assert rig.sensor.health().received > 20


def test_a_controller_at_another_speed_of_the_line_is_told_with_what_it_said() -> None:
    rig, port = made(RecordForm.ASCII)
    port.spoil = 10**9
    with pytest.raises(DeviceError, match="but sent b'"):
        rig.sensor.start()


@pytest.mark.parametrize("sampling_Hz", [70.0, 84.0])
def test_another_rate_than_configured_is_refused_with_both(sampling_Hz: float) -> None:
    rig, _ = made(
        RecordForm.ASCII, rate_Hz=80.0, twin=AtiSerialTwinSettings(sampling_Hz=sampling_Hz)
    )
    rig.sensor.start()
    with pytest.raises(DeviceError, match=r"sends \d+\.\d records/s, the settings say 80"):
        rig.run(1.5)


def test_a_line_too_slow_for_the_rate_is_refused_with_what_it_carries() -> None:
    with pytest.raises(
        BadInput, match=r"at 38400 bit/s the line carries 85\.3 records/s in the form 'ascii'"
    ):
        keys(rate_Hz=250.0)
    keys(rate_Hz=250.0, form=RecordForm.BINARY_CHECKSUM)


@pytest.mark.parametrize("name", ["counts_per_N", "counts_per_Nm", "rate_Hz", "bits_per_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_settings_that_cannot_be_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(BadInput, match=f"{name}: should be"):
        keys(**{name: value})


@pytest.mark.parametrize("form", list(RecordForm))
def test_a_bias_takes_off_what_is_felt_now_and_the_stream_goes_on(form: RecordForm) -> None:
    rig, _ = made(form)
    rig.wrench = constant(4.0, 0.0, -4.0, 0.3, 0.0, 0.0)
    rig.sensor.start()
    rig.run(0.2)
    rig.sensor.bias()
    samples = rig.run(0.3)
    assert len(samples.sequence) > 10
    assert not samples.counts.any()


def test_noise_on_the_line_never_raises_and_the_stream_comes_back() -> None:
    rig, port = made(RecordForm.BINARY_CHECKSUM)
    random = np.random.default_rng(5)
    rig.sensor.start()
    rig.run(1.2)
    for _ in range(40):
        port.held += random.bytes(int(random.integers(0, 40)))
        port.drop = int(random.integers(0, 20))
        rig.run(0.05)
    samples = rig.run(1.0)
    assert len(samples.sequence) > 240
    units = rig.in_units(samples)
    assert np.abs(units).max() < 4.0


def test_records_lost_without_a_trace_move_the_clock_on() -> None:
    """As when the computer's own buffer ran over: whole records are gone, and nothing in the
    bytes shows it.
    """
    rig, port = made(RecordForm.BINARY)
    rig.sensor.start()
    rig.run(1.2)
    port.drop = 50 * RecordForm.BINARY.record_bytes
    samples = rig.run(1.0)
    assert rig.sensor.health().lost == pytest.approx(50, abs=3)
    assert samples.device_s[-1] == pytest.approx(2.2, abs=0.03)


@pytest.mark.parametrize("form", list(RecordForm))
def test_one_spoilt_record_is_one_lost_record_at_its_own_place(form: RecordForm) -> None:
    rig, port = made(form)
    rig.sensor.start()
    rig.run(1.2)
    before = np.concatenate([block.sequence for block in rig.blocks])[-1]
    port.held = b""
    port.spoil = form.record_bytes - 1
    samples = rig.run(0.3)
    assert rig.sensor.health().lost == rig.sensor.health().malformed == 1
    assert samples.sequence[:3].tolist() == [before + 2, before + 3, before + 4]


@pytest.mark.parametrize("form", list(RecordForm))
def test_what_is_still_on_the_line_when_stopped_is_not_handed_over(form: RecordForm) -> None:
    rig, port = made(form)
    rig.sensor.start()
    rig.run(0.3)
    rig.clock.wait_until(rig.clock.now_s() + 0.2)
    assert port.in_waiting > 5 * form.record_bytes
    rig.sensor.stop()
    assert len(rig.sensor.read().sequence) == 0
    port.held = b">" * 30 + port.held
    rig.sensor.start()
    assert rig.run(0.3).sequence[0] == 1
    assert rig.sensor.health().malformed == 0


def test_the_twin_sends_no_more_than_its_line_carries() -> None:
    host, device = serial_line()
    twin = AtiSerialTwin(
        device, AtiSerialTwinSettings(sampling_Hz=1000.0), np.random.default_rng(1)
    )
    host.write(b"QS\r")
    twin.take_requests()
    for end_s in np.arange(1, 1001) * 2e-3:
        twin.take_wrench(np.ones((len(twin.due(end_s)), 6)))
    lines = host.read(10**6).split(b"\n")[1:-1]
    assert twin.record_rate_Hz == pytest.approx(1000.0 / 12)
    assert len(lines) == pytest.approx(2.0 * 1000.0 / 12, abs=1)


def test_the_wrong_form_of_records_says_what_to_try() -> None:
    rig, _ = made(RecordForm.BINARY_CHECKSUM)
    rig.sensor.start()
    rig.twin._with_checksum = False
    rig.run(0.5)
    assert any("try another form" in note for note in rig.sensor.health().notes)


def test_a_closed_port_is_an_error_of_the_device() -> None:
    rig, port = made(RecordForm.ASCII)
    rig.sensor.start()
    port.close()
    for act in (rig.sensor.stop, rig.sensor.read, rig.sensor.start):
        with pytest.raises(DeviceError, match="check the cable"):
            rig.sensor._running = True
            act()


def test_one_record_is_sent_for_a_query_and_then_the_prompt() -> None:
    host, device = serial_line()
    twin = AtiSerialTwin(device, AtiSerialTwinSettings(), np.random.default_rng(1))
    host.write(b"qr\r")
    twin.take_requests()
    twin.take_wrench(np.full((len(twin.due(0.01)), 6), 1.0))
    assert host.read(100) == b"qr\r\n0,    20,    20,    20,   333,   333,   333\r\n>"


def test_driver_and_twin_also_work_over_a_pseudo_terminal_and_pyserial() -> None:
    device_side, client_side = pty.openpty()
    tty.setraw(client_side)
    os.set_blocking(device_side, False)

    class Terminal:
        def read(self) -> bytes:
            try:
                return os.read(device_side, 4096)
            except BlockingIOError:
                return b""

        def write(self, data: bytes) -> int:
            return os.write(device_side, data)

    class Unhurried(TwinClock):
        """Bytes take their time through a pseudo terminal, so the twin's time takes as long as
        real time.
        """

        def wait_until(self, t_s: float) -> None:
            time.sleep(max(0.0, t_s - self.now_s()))
            super().wait_until(t_s)

    clock = Unhurried()
    port = open_port(os.ttyname(client_side), 38_400)
    settings = keys(rate_Hz=250.0, form=RecordForm.BINARY_CHECKSUM)
    twin = AtiSerialTwin(Terminal(), AtiSerialTwinSettings(), np.random.default_rng(1))
    rig = ForceSensorRig(
        clock,
        AtiSerialSensor(port, clock, settings),
        twin,
        250.0,
        0.0,
        np.zeros(6),
        (),
        *[lambda: None] * 4,
    )
    try:
        rig.sensor.start()
        samples = rig.run(0.8)
        assert len(samples.sequence) == pytest.approx(200, abs=10)
        assert rig.sensor.health().malformed == 0
    finally:
        port.close()
        os.close(device_side)
        os.close(client_side)


def test_a_port_that_is_not_there_is_told() -> None:
    with pytest.raises(DeviceError, match="serial port /dev/not-there cannot be opened"):
        open_port("/dev/not-there", 38_400)

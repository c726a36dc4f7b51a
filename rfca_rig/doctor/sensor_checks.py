"""The force sensor's side of a rig."""

from collections.abc import Iterator

from rfca_rig.clock import Clock
from rfca_rig.description.force_sensor_sections import AtiDaqSection, AtiSerialSection, ForceSensor, NetFtSection, OwnForceSensorSection
from rfca_rig.doctor.finding import Colour, Finding
from rfca_rig.doctor.judging.ati_daq import judge_calibration, judge_card
from rfca_rig.doctor.judging.ati_serial import judge_controller
from rfca_rig.doctor.judging.netft import judge_box, judge_stream
from rfca_rig.doctor.judging.receive_buffer import judge_receive_buffer
from rfca_rig.doctor.judging.serial_port import judge_serial_port
from rfca_rig.doctor.looking.ati_daq import look_at_calibration, look_for_cards
from rfca_rig.doctor.looking.ati_serial import look_at_controller
from rfca_rig.doctor.looking.computer import granted_receive_buffer
from rfca_rig.doctor.looking.netft import look_at_box, look_at_stream
from rfca_rig.doctor.looking.serial_port import look_at_serial_port
from rfca_rig.drivers.datagrams import RECEIVE_BUFFER_BYTES
from rfca_rig.drivers.netft import NetFtSettings
from rfca_rig.drivers.netft_box import Box, CommandBox, HttpBox


def check_sensor(sensor: ForceSensor, clock: Clock) -> Iterator[Finding]:
    """Streams from the sensor that [force_sensor] names for about a second."""
    match sensor:
        case NetFtSection():
            return _netft(sensor, clock)
        case AtiSerialSection():
            return _controller(sensor, clock)
        case AtiDaqSection():
            return _daq(sensor)
        case OwnForceSensorSection():
            return iter(())  # its own driver is asked: own_checks


def _netft(sensor: NetFtSection, clock: Clock) -> Iterator[Finding]:
    settings = NetFtSettings(counts_per_N=sensor.counts_per_N, counts_per_Nm=sensor.counts_per_Nm, rate_Hz=sensor.rate_Hz)
    box, answers = _box(sensor), None
    if box is not None:
        seen = look_at_box(sensor.host, box)
        answers = seen.says is not None
        yield judge_box(seen, settings)
    yield from judge_stream(look_at_stream(sensor.host, sensor.port, sensor.buffered, clock), settings, answers)
    yield judge_receive_buffer(granted_receive_buffer(), RECEIVE_BUFFER_BYTES, sensor.rate_Hz)


def _box(sensor: NetFtSection) -> Box | None:
    if sensor.configuration == "http":
        return HttpBox(sensor.host, sensor.http_port)
    return CommandBox(sensor.host, sensor.command_port) if sensor.configuration == "commands" else None


def _controller(sensor: AtiSerialSection, clock: Clock) -> Iterator[Finding]:
    port = judge_serial_port(look_at_serial_port(sensor.port), "[force_sensor]")
    yield port
    if port.colour is not Colour.RED:
        yield from judge_controller(look_at_controller(sensor.port, sensor.settings(), clock), sensor.rate_Hz)


def _daq(sensor: AtiDaqSection) -> Iterator[Finding]:
    yield judge_calibration(sensor.calibration_file, look_at_calibration(sensor.calibration_file))
    yield judge_card(look_for_cards(), sensor.channels)

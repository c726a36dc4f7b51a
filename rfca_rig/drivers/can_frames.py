"""CAN buses: their settings, sending and receiving frames, and health from error frames.

Every failure of a bus becomes a DeviceError.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers import fdcanusb
from rfca_rig.drivers.guard import GuardianTorqueOff
from rfca_rig.errors import DeviceError

# Error classes, in the arbitration id.
CONTROLLER = 0x004
BUS_OFF = 0x040
RESTARTED = 0x100
COUNTERS = 0x200
# Bits of data byte 1 of an error frame of class CONTROLLER.
OVERFLOW = 0x01 | 0x02
PASSIVE = 0x10 | 0x20
ACTIVE = 0x40
# Below this error count a controller is error-active.
ACTIVE_AGAIN = 128

# Sample point of both phases of CAN-FD that the drives of mjbots need (their reference, "CAN-FD"),
# and the clock of PEAK's adapters that gives it exactly at 1 and 5 Mbit/s (60 and 12 parts a bit).
FD_SAMPLE_POINT_PERCENT = 66.6
PCAN_CLOCK_HZ = 60_000_000

EMERGENCY_STOP_REMEDY = "press the emergency stop if it turns"
# Time in s for all torque-off frames together, and between two attempts. Drivers promise torque off
# within 20 ms.
STOPPING_S = 0.02
RETRY_S = 1e-3
# After a longer pause between two reads the receive buffer may have overflowed, with frames missing
# anywhere.
MAX_READ_PAUSE_S = 0.1


class BusHealth:
    """Takes in the error frames of one bus. `fault` warns that the bus is about to fail, while
    frames still pass.

    A controller counts up errors if no node acknowledges its frames, or if it receives invalid
    ones. From 128 on it is error-passive, and at 256 transmit errors it goes bus-off. With adapters
    that send no error frames nothing is counted.
    """

    def __init__(self) -> None:
        self.error_frames = 0
        self.overflows = 0
        # (transmit, receive) error counters, if the controller reports them.
        self.counters: tuple[int, int] | None = None
        self._passive = False

    def note(self, message: can.Message) -> None:
        """Takes in one error frame. Raises DeviceError if it reports bus-off."""
        self.error_frames += 1
        # Some adapters send shorter error frames than the eight bytes that the format has.
        classes = message.arbitration_id
        data = bytes(message.data).ljust(8, b"\0")
        if classes & BUS_OFF:
            raise DeviceError(_OFF)
        if classes & COUNTERS:
            self.counters = data[6], data[7]
            # Counters below the limit show a recovery even if the frame that reports it was lost.
            self._passive &= max(self.counters) >= ACTIVE_AGAIN
        if classes & RESTARTED:
            self._passive = False
        if classes & CONTROLLER:
            self.overflows += bool(data[1] & OVERFLOW)
            self._passive = bool(data[1] & PASSIVE) or (self._passive and not data[1] & ACTIVE)

    def check_state(self, bus: can.BusABC) -> None:
        """Checks the bus state, for adapters that report bus-off without an error frame. Raises
        DeviceError if it is off.
        """
        if bus.state is can.BusState.ERROR:
            raise DeviceError(_OFF)

    @property
    def fault(self) -> str | None:
        """Warning in one line; None while the controller is error-active."""
        if not self._passive:
            return None
        if self.counters is None:
            counters = ""
        else:
            counters = (
                f", transmit and receive error counters {self.counters[0]} and {self.counters[1]}"
            )
        return (
            f"CAN controller is error-passive{counters}; check wiring, termination and bit "
            "rate, and that the drive has power"
        )

    def facts(self) -> dict[str, str]:
        """For the recording."""
        return {"can_error_frames": str(self.error_frames), "can_overflows": str(self.overflows)}


_OFF = "CAN bus is off after too many errors; check wiring and bit rate, then restart the interface"


def arrival_s(message: can.Message, since_s: float, drained_s: float, wall_s: float) -> float:
    """Host time in s at which a frame arrived, by the stamp that the bus gave it.

    Frames wait in the bus until the next drain. Where both keep the same beat they wait equally
    long every time, so that no shortest delay shows it.

    Parameters
    ----------
    message
        A frame. Sockets of Linux stamp frames with the system time of their arrival; some adapters
        with a time of their own, or not at all.
    since_s, drained_s
        Host times of the drain before and of this one.
    wall_s
        System time in s since 1970, read with `drained_s`.

    Returns
    -------
    float
        `drained_s` where the stamp is not from the time between both drains.
    """
    waited_s = wall_s - message.timestamp
    if 0.0 <= waited_s <= drained_s - since_s:
        return drained_s - waited_s
    return drained_s


def receive_frames(
    bus: can.BusABC, health: BusHealth, remedy: str = EMERGENCY_STOP_REMEDY
) -> Iterator[can.Message]:
    """Every data frame that the bus holds, oldest first; never waits.

    Error frames go to `health`. Raises DeviceError, with the remedy, if the bus fails or went
    bus-off.
    """
    try:
        while (message := bus.recv(timeout=0)) is not None:
            if message.is_error_frame:
                health.note(message)
            elif not message.is_remote_frame:
                yield message
        # Not every adapter reports bus-off by an error frame.
        health.check_state(bus)
    # A torque-off by the guardian is reported with its own text, not as a bus failure.
    except GuardianTorqueOff as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        raise DeviceError(f"CAN bus failed while reading the drive: {error}; {remedy}") from error


def send(bus: can.BusABC, message: can.Message, remedy: str = EMERGENCY_STOP_REMEDY) -> None:
    """Sends one frame without waiting. Raises DeviceError, with the remedy, if the bus does not
    accept it.
    """
    try:
        bus.send(message, timeout=0.0)
    except GuardianTorqueOff as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        if message.is_extended_id:
            identifier = f"{message.arbitration_id:08x}"
        else:
            identifier = f"{message.arbitration_id:03x}"
        raise DeviceError(
            f"CAN frame 0x{identifier} to the drive not sent: {error}; {remedy}"
        ) from error


def send_stop(
    bus: can.BusABC,
    clock: Clock,
    messages: Sequence[can.Message],
    remedy: str = EMERGENCY_STOP_REMEDY,
) -> None:
    """Sends torque-off frames. A frame that is not accepted is tried again, as the transmit queue
    may be full for a moment.

    Every frame is tried at least once, even if the one before failed; all of it takes 20 ms at
    most. Raises DeviceError if one was not accepted.
    """
    until_s = clock.now_s() + STOPPING_S
    failures = [
        failure
        for message in messages
        if (failure := _failure(bus, clock, message, remedy, until_s)) is not None
    ]
    if failures:
        raise failures[0]


def _failure(
    bus: can.BusABC, clock: Clock, message: can.Message, remedy: str, until_s: float
) -> DeviceError | None:
    while True:
        try:
            send(bus, message, remedy)
        except DeviceError as error:
            if clock.now_s() + RETRY_S > until_s:
                return error
            clock.wait_until(clock.now_s() + RETRY_S)
        else:
            return None


def list_interfaces() -> tuple[str, ...]:
    """Names of all interfaces that `CanBusSettings` opens, in alphabetical order."""
    return tuple(sorted({*can.VALID_INTERFACES, fdcanusb.INTERFACE}))


@dataclass(frozen=True)
class CanBusSettings:
    """Arguments of `can.Bus`; python-can's own configuration (`CAN_CONFIG`, can.conf) supplies the
    rest. The interface "fdcanusb", which python-can lacks, is opened here.

    `data_bitrate` is the bit rate of the CAN-FD data phase, None for classic CAN.
    """

    interface: str
    channel: str
    bitrate: int
    data_bitrate: int | None = None

    def preload(self) -> None:
        """Imports the interface, which takes up to a few tenths of a second, so that `open` need
        not when it must be quick.
        """
        module, _ = can.interfaces.BACKENDS.get(self.interface, ("can", ""))
        # `open` reports what is missing, in its own words.
        with suppress(ImportError, OSError):
            import_module(module)

    def open(self) -> can.BusABC:
        """Opens the bus; the caller shuts it down. Raises what python-can raises."""
        if self.interface == fdcanusb.INTERFACE:
            return fdcanusb.FdcanusbBus(self.channel, self.bitrate, self.data_bitrate)
        if self.interface == "socketcand":
            # Small frames must not wait for the acknowledgement of the ones before, up to 40 ms.
            # Windows has no such option.
            return can.Bus(
                interface=self.interface,
                channel=self.channel,
                bitrate=self.bitrate,
                tcp_tune=os.name != "nt",
            )
        if self.data_bitrate is None:
            return can.Bus(interface=self.interface, channel=self.channel, bitrate=self.bitrate)
        if self.interface == "pcan":
            # For CAN-FD it takes the segments of a bit instead of bit rates.
            timing = can.BitTimingFd.from_sample_point(
                f_clock=PCAN_CLOCK_HZ,
                nom_bitrate=self.bitrate,
                nom_sample_point=FD_SAMPLE_POINT_PERCENT,
                data_bitrate=self.data_bitrate,
                data_sample_point=FD_SAMPLE_POINT_PERCENT,
            )
            return can.Bus(interface=self.interface, channel=self.channel, timing=timing)
        return can.Bus(
            interface=self.interface,
            channel=self.channel,
            bitrate=self.bitrate,
            data_bitrate=self.data_bitrate,
            fd=True,
        )

"""Settings of a moteus, queries to it, and its replies: decoded, kept apart from other drives, and time-stamped."""

from collections import deque
from dataclasses import dataclass
from math import isfinite, nan

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import moteus
from rfca_rig.codecs.moteus import LARGEST_ID, LARGEST_PREFIX, Read, Refusal, Reply, Subframe
from rfca_rig.codecs.moteus_registers import Register, Width, mode_text, name_of, register_error_text
from rfca_rig.drivers.can_frames import BusHealth, receive_frames
from rfca_rig.drivers.device_time import CounterClock
from rfca_rig.drivers.motors.drive_report import EncoderJumpMonitor, ShaftGear, check_positive
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import BadInput, DeviceError

# The vendor's tools use source id 0, and answers go to the id that asked.
OWN_ID = 0x20

STATE_QUERY = (
    Read(Register.MODE, Width.INT8),
    Read(Register.POSITION, Width.FLOAT),
    Read(Register.VELOCITY, Width.FLOAT),
    Read(Register.TORQUE, Width.FLOAT),
    Read(Register.MOTOR_TEMPERATURE, Width.INT16),
    Read(Register.VOLTAGE, Width.INT16),
    Read(Register.TEMPERATURE, Width.INT16),
    Read(Register.FAULT, Width.INT16),
    Read(Register.MILLISECOND_COUNTER, Width.INT32),
)
# A reply without these registers is no state. Voltage and temperatures are only shown, so they may be missing.
_REQUIRED = frozenset(read.register for read in STATE_QUERY) - {
    Register.VOLTAGE,
    Register.TEMPERATURE,
    Register.MOTOR_TEMPERATURE,
}

IDENTITY_QUERY = tuple(
    Read(register, Width.INT32)
    for register in (
        Register.MODEL_NUMBER,
        Register.FIRMWARE_VERSION,
        Register.REGISTER_MAP_VERSION,
        Register.SERIAL_NUMBER_1,
        Register.SERIAL_NUMBER_2,
        Register.SERIAL_NUMBER_3,
    )
)


@dataclass(frozen=True)
class MoteusSettings(ShaftGear):
    """Settings of the drive.

    `gear_ratio` is turns of the drive's output per shaft turn; it is 1 for a gear that motor_position.rotor_to_output_ratio already
    includes. `direction` is +1 or -1, `zero_turns` the drive's position with the shaft horizontal. `watchdog_s` is sent with every
    command: the drive stops the motor if no other follows within that time. `torque_limit_Nm` applies at the shaft; None keeps the
    drive's own. Raises BadInput for invalid values.
    """

    drive_id: int = 1
    own_id: int = OWN_ID
    can_prefix: int = 0
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    watchdog_s: float = 0.1
    torque_limit_Nm: float | None = None
    reply_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0
    bitrate_switch: bool = True

    def __post_init__(self) -> None:
        if not 1 <= self.drive_id <= LARGEST_ID:
            raise BadInput(f"drive: drive_id is {self.drive_id}, must be 1..{LARGEST_ID}")
        if not 0 <= self.own_id <= LARGEST_ID or self.own_id == self.drive_id:
            raise BadInput(f"drive: own_id is {self.own_id}, must be 0..{LARGEST_ID} and not the drive's")
        if not 0 <= self.can_prefix <= LARGEST_PREFIX:
            raise BadInput(f"drive: can_prefix is {self.can_prefix}, must be 0..{LARGEST_PREFIX}")
        self.check_gear()
        for name in ("watchdog_s", "reply_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_limit_Nm is not None:
            check_positive("torque_limit_Nm", self.torque_limit_Nm)


@dataclass(frozen=True)
class MoteusState:
    """The last answer, in the drive's units."""

    mode: int
    fault: int
    position_turns: float
    voltage_V: float
    temperature_degC: float
    motor_temperature_degC: float

    @property
    def warmest_C(self) -> float | None:
        """Higher of board and motor temperature in degrees C; None if neither is reported."""
        reported = [value for value in (self.temperature_degC, self.motor_temperature_degC) if isfinite(value)]
        return max(reported, default=None)


class MoteusReplies:
    """Receives replies. `state` is the drive's last answer, `facts` holds its identity registers, read when it was enabled.

    A drive answers each query once. An answer therefore belongs to the query whose time fits its millisecond counter best; older
    queries without an answer count as lost.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MoteusSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._time = CounterClock()
        self._asked_s: deque[float] = deque()
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._stamped_s = -1.0
        self._leap = EncoderJumpMonitor()
        self.health = BusHealth()
        self.state: MoteusState | None = None
        self.facts: dict[int, float] = {}
        self.drained_s = clock.now_s()
        self.lost = 0
        self.reset_counters()

    def reset_counters(self) -> None:
        """Restarts the counters behind `missing`; open queries are forgotten."""
        self._asked_s.clear()
        self._foreign_ids: set[int] = set()
        self._refusals: dict[int, int] = {}
        self.answers = 0

    def note_query(self) -> None:
        """Notes that a state query has been sent."""
        self._asked_s.append(self._clock.now_s())

    def drain(self) -> None:
        """Receives everything the bus holds; never waits.

        Raises DeviceError if the bus fails, if a frame cannot be decoded, and if the drive reports no position.
        """
        self.drained_s = self._clock.now_s()
        for message in receive_frames(self._bus, self.health):
            self._take(message)

    def samples(self) -> ShaftSamples:
        """Samples (m,) drained since the last call. `host_s` is the time of the query, within 1 ms of the time of the measurement."""
        rows, self._rows = np.array(self._rows).reshape(-1, 5), []
        settings = self._settings
        return ShaftSamples(
            host_s=rows[:, 0],
            device_s=rows[:, 1],
            angle_rad=(rows[:, 2] - settings.zero_turns) * settings.shaft_rad_per_turn,
            speed_rad_s=rows[:, 3] * settings.shaft_rad_per_turn,
            torque_Nm=rows[:, 4] * settings.shaft_torque_per_drive_torque,
        )

    @property
    def silent_s(self) -> float:
        """Age in s of the oldest open query, 0 if none is open. A drive that is not asked sends nothing."""
        return self.drained_s - self._asked_s[0] if self._asked_s else 0.0

    @property
    def restarts(self) -> int:
        return self._time.restarts

    @property
    def zero_lost(self) -> str | None:
        """Why the angle can no longer be trusted, or None. Never reset."""
        if self.restarts:
            return "the drive restarted, its millisecond counter began again; turns that it had counted are lost: find its zero again"
        return self._leap.fault

    def missing(self) -> str | None:
        """Why there is no usable answer since `reset_counters`, with the remedy; None if there is one."""
        drive = self._settings.drive_id
        if self._refusals:
            refused = ", ".join(f"{name_of(register)}: {register_error_text(code)}" for register, code in self._refusals.items())
            return f"drive {drive} cannot tell {refused}; check that its firmware knows that register, and update it"
        if self.answers > 0:
            return None
        if self._foreign_ids:
            others = ", ".join(map(str, sorted(self._foreign_ids)))
            return f"CAN frames from id {others} but no answer from drive {drive}; check drive_id and can_prefix"
        return (
            f"no answer from drive {drive}, and no other frames on the CAN bus; check the drive's power, the wiring, the termination, "
            "drive_id (a moteus speaks only when asked), and that the interface does CAN-FD at 1 and 5 Mbit/s"
        )

    def _take(self, message: can.Message) -> None:
        route = moteus.route_of(message.arbitration_id)
        if route.wants_reply or route.source == self._settings.own_id:
            # A request: by another master, or our own echoed by the adapter.
            return
        if (route.source, route.prefix) != (self._settings.drive_id, self._settings.can_prefix):
            self._foreign_ids.add(route.source)
        elif route.destination == self._settings.own_id:
            self._hear(moteus.decode(message.data))

    def _hear(self, subframes: list[Subframe]) -> None:
        values = {item.register: item.value for item in subframes if isinstance(item, Reply)}
        self._refusals |= {item.register: item.code for item in subframes if isinstance(item, Refusal) and item.register in _REQUIRED}
        if values.keys() >= _REQUIRED:
            self._hear_state(values)
        else:
            self.facts |= values

    def _hear_state(self, values: dict[int, float]) -> None:
        counter = int(values[Register.MILLISECOND_COUNTER])
        asked_s = self._match_query(counter)
        if asked_s is None:
            # No query is open: the frame was duplicated on the way.
            return
        # A limit check on a position or speed that is not finite would never trip.
        if not (isfinite(values[Register.POSITION]) and isfinite(values[Register.VELOCITY])):
            raise DeviceError(
                f"drive {self._settings.drive_id} knows no position, mode {mode_text(int(values[Register.MODE]))}; check its encoder"
            )
        self.answers += 1
        self.state = MoteusState(
            mode=int(values[Register.MODE]),
            fault=int(values[Register.FAULT]),
            position_turns=values[Register.POSITION],
            voltage_V=values.get(Register.VOLTAGE, nan),
            temperature_degC=values.get(Register.TEMPERATURE, nan),
            motor_temperature_degC=values.get(Register.MOTOR_TEMPERATURE, nan),
        )
        stamp_s = self._time.stamp(counter, asked_s)
        # Two answers with the same time carry the same sample.
        if stamp_s > self._stamped_s:
            self._stamped_s = stamp_s
            self._rows.append((asked_s, stamp_s, values[Register.POSITION], values[Register.VELOCITY], values[Register.TORQUE]))
            # A jump is the same in either direction of the shaft, so the sign is left out here.
            per_turn = abs(self._settings.shaft_rad_per_turn)
            self._leap.follow(asked_s, stamp_s, per_turn * values[Register.POSITION], per_turn * values[Register.VELOCITY])

    def _match_query(self, counter: int) -> float | None:
        """Time of the query that the answer with this counter belongs to; None without open queries. Older ones are dropped."""
        if not self._asked_s:
            return None
        best = min(range(len(self._asked_s)), key=lambda index: self._time.distance_s(counter, self._asked_s[index]))
        for _ in range(best):
            self._asked_s.popleft()
        self.lost += best
        return self._asked_s.popleft()

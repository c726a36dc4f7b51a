"""What a moteus is asked and answers: asked with every command, taken in, kept apart from other drives, and stamped."""

from collections import deque
from dataclasses import dataclass
from math import isfinite, nan

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import moteus
from rfca_rig.codecs.moteus import Read, Refusal, Reply, Subframe
from rfca_rig.codecs.moteus_meanings import mode_text, register_error_text
from rfca_rig.codecs.moteus_registers import Register, Width, name_of
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.can_frames import arrived
from rfca_rig.drivers.counter_clock import CounterClock
from rfca_rig.drivers.encoder_jump import LeapWatch
from rfca_rig.drivers.moteus_scale import MoteusSettings
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import DeviceError

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
_LIVED_ON = frozenset(read.register for read in STATE_QUERY) - {
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
        """Of board and motor; None where neither is told."""
        told = [value for value in (self.temperature_degC, self.motor_temperature_degC) if isfinite(value)]
        return max(told, default=None)


class MoteusReplies:
    """Asks and listens. `state` is the drive's last answer, `facts` what it said of itself when it was enabled.

    A drive answers each question once, so an answer belongs to the question whose moment fits its millisecond counter best;
    older questions without an answer count as lost.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MoteusSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._time = CounterClock()
        self._asked_s: deque[float] = deque()
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._stamped_s = -1.0
        self._leap = LeapWatch()
        self.health = BusHealth()
        self.state: MoteusState | None = None
        self.facts: dict[int, float] = {}
        self.drained_s = clock.now_s()
        self.lost = 0
        self.recount()

    def recount(self) -> None:
        """What `missing` speaks of begins now; questions asked before are forgotten."""
        self._asked_s.clear()
        self._foreign_ids: set[int] = set()
        self._refusals: dict[int, int] = {}
        self.answers = 0

    def asked(self) -> None:
        """To be called when a question for the state has been sent."""
        self._asked_s.append(self._clock.now_s())

    def drain(self) -> None:
        """Takes in everything the bus holds; never waits.

        Raises DeviceError on a failing bus, a frame that cannot be read, and a drive that does not know where it is.
        """
        self.drained_s = self._clock.now_s()
        for message in arrived(self._bus, self.health):
            self._take(message)

    def samples(self) -> ShaftSamples:
        """Everything drained since the last call. `host_s` is when the host asked: within a millisecond of when the shaft was there."""
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
        """How long the oldest open question has been waiting; 0 where none is open. A drive that nobody asks says nothing."""
        return self.drained_s - self._asked_s[0] if self._asked_s else 0.0

    @property
    def restarts(self) -> int:
        return self._time.restarts

    @property
    def zero_lost(self) -> str | None:
        """Why the angle is not to be believed any more; not forgiven."""
        if self.restarts:
            return "the drive restarted, its millisecond counter began anew; turns that it had counted are lost: find its zero again"
        return self._leap.fault

    def missing(self) -> str | None:
        """Why there is no answer, since `recount`, that the driver could live on; and what to do about it."""
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
            return  # a request, of another master or our own come back
        if (route.source, route.prefix) != (self._settings.drive_id, self._settings.can_prefix):
            self._foreign_ids.add(route.source)
        elif route.destination == self._settings.own_id:
            self._hear(moteus.decode(message.data))

    def _hear(self, subframes: list[Subframe]) -> None:
        values = {item.register: item.value for item in subframes if isinstance(item, Reply)}
        self._refusals |= {item.register: item.code for item in subframes if isinstance(item, Refusal) and item.register in _LIVED_ON}
        if values.keys() >= _LIVED_ON:
            self._hear_state(values)
        else:
            self.facts |= values

    def _hear_state(self, values: dict[int, float]) -> None:
        counter = int(values[Register.MILLISECOND_COUNTER])
        asked_s = self._question_of(counter)
        if asked_s is None:
            return  # doubled on the way
        self._check_position(values)
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
        if stamp_s > self._stamped_s:  # two answers of one moment say one thing
            self._stamped_s = stamp_s
            self._rows.append((asked_s, stamp_s, values[Register.POSITION], values[Register.VELOCITY], values[Register.TORQUE]))
            per_turn = abs(self._settings.shaft_rad_per_turn)
            self._leap.follow(asked_s, stamp_s, per_turn * values[Register.POSITION], per_turn * values[Register.VELOCITY])

    def _check_position(self, values: dict[int, float]) -> None:
        """A limit on the angle means nothing to an angle that is no number."""
        if not (isfinite(values[Register.POSITION]) and isfinite(values[Register.VELOCITY])):
            raise DeviceError(
                f"drive {self._settings.drive_id} knows no position, mode {mode_text(int(values[Register.MODE]))}; check its encoder"
            )

    def _question_of(self, counter: int) -> float | None:
        """When the question was asked that is answered with this counter. Older open questions are given up."""
        if not self._asked_s:
            return None
        best = min(range(len(self._asked_s)), key=lambda at: self._time.distance_s(counter, self._asked_s[at]))
        for _ in range(best):
            self._asked_s.popleft()
        self.lost += best
        return self._asked_s.popleft()

"""What an AK drive in MIT mode says: taken in, kept apart from others, and stamped with the time at which it was asked."""

from collections import deque
from collections.abc import Sequence

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_mit import MitReply, decode_reply, position_of
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.can_frames import arrived
from rfca_rig.drivers.cubemars_settings import MitSettings
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.drivers.speed_check import SpeedCheck
from rfca_rig.drivers.wrapped_position import CODES, WrappedPosition

RESYNC_S = 0.02
REMEMBERED = 64
LEAP_RAD = 0.3


class MitReplies:
    """Listens for one drive. The drive answers each frame once and at once, so a reply tells how the shaft was when it was asked.

    `angle_rad` (continuous), `speed_rad_s` and `torque_Nm` are the shaft's as of `at_s`; `reply` the last one as it came.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MitSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        counts_per_rad = (CODES - 1) / (2.0 * settings.ranges.position_rad)
        fastest = settings.ranges.speed_rad_s * counts_per_rad
        self._position = WrappedPosition(frozenset({0, CODES - 1}), fastest, LEAP_RAD * counts_per_rad)
        self._speed = SpeedCheck("model: it decides the scale of the speed")
        self._asked_s: deque[float] = deque(maxlen=REMEMBERED)
        self._unanswered_s: float | None = None
        self._whole_s = clock.now_s()  # when no question was open
        self._first_s: float | None = None
        self._rows: list[tuple[float, ...]] = []
        self.drained_s = clock.now_s()
        self.reply: MitReply | None = None
        self.at_s = -np.inf
        self.angle_rad = self.speed_rad_s = self.torque_Nm = np.nan
        self.lost = 0
        self.health = BusHealth()
        self.recount()

    def recount(self) -> None:
        """What `missing` speaks of begins now; faults of the motion are forgiven."""
        self._position.forgive()
        self._speed.forgive()
        self._foreign: set[int] = set()
        self._masters: set[int] = set()
        self._servo: set[int] = set()
        self.heard = 0
        self.at_s = -np.inf  # the next reply counts, even at the moment of an older one
        self._told_errors = self._is_cut = False

    def asked(self) -> None:
        """To be called with every frame that goes to the drive."""
        if not self._asked_s:
            self._whole_s = self._clock.now_s()
        self._asked_s.append(self._clock.now_s())
        if self._unanswered_s is None:
            self._unanswered_s = self._clock.now_s()

    def drain(self) -> None:
        """Takes in everything the bus holds; never waits. Raises DeviceError on a failing bus or a frame that cannot be read."""
        self.drained_s = self._clock.now_s()
        replies: list[MitReply] = []
        try:
            for message in arrived(self._bus, self.health):
                self._take(message, replies)
        finally:
            self._stamp(replies)

    def _take(self, message: can.Message, replies: list[MitReply]) -> None:
        identifier, data, drive = message.arbitration_id, message.data, self._settings.drive_id
        if message.is_extended_id:
            if identifier >> 8 == cubemars_servo.Packet.STATUS:
                self._servo.add(cubemars_servo.drive_of(identifier))
        elif not data:
            return
        elif identifier in {0, drive} and data[0] == drive:
            replies.append(decode_reply(self._settings.ranges, data))
        elif data[0] == drive:
            self._masters.add(identifier)
        else:
            self._foreign.add(data[0] if identifier == 0 else identifier)

    def _stamp(self, replies: Sequence[MitReply]) -> None:
        times_s = self._answered(len(replies))
        self.heard += len(replies)
        for reply, t_s in zip(replies[len(replies) - len(times_s) :], times_s, strict=True):
            self._follow(reply, t_s)

    def _answered(self, count: int) -> list[float]:
        """When `count` replies were asked for: in order, for a bus keeps it and a slow adapter may hold some back for a while.

        Where some question has stayed open for `RESYNC_S` a reply was lost, and the newest belong to the newest.
        """
        asked = list(self._asked_s)
        is_lost = 0 < count < len(asked) and self.drained_s - self._whole_s > RESYNC_S
        answered, open_s = (asked[-count:], []) if is_lost else (asked[:count], asked[count:])
        self.lost += len(asked) - count if is_lost else 0
        if count:
            self._asked_s = deque(open_s, REMEMBERED)
            self._unanswered_s = open_s[0] if open_s else None
        if not self._asked_s:
            self._whole_s = self.drained_s
        return answered

    def _follow(self, reply: MitReply, t_s: float) -> None:
        self.reply = reply
        self._is_cut |= self._told_errors and reply.error is None
        self._told_errors |= reply.error is not None
        if t_s <= self.at_s:
            return  # asked twice at one moment: the same again
        settings = self._settings
        count = self._position.follow(reply.position_code, t_s, reply.speed_rad_s)
        self._first_s = t_s if self._first_s is None else self._first_s
        self.at_s = t_s
        self.angle_rad = settings.direction * (position_of(settings.ranges, count) - settings.zero_rad)
        self.speed_rad_s = settings.direction * reply.speed_rad_s
        self.torque_Nm = settings.direction * reply.torque_Nm
        self._speed.follow(t_s, self.angle_rad, self.speed_rad_s)
        self._rows.append((self.drained_s, t_s - self._first_s, self.angle_rad, self.speed_rad_s, self.torque_Nm))

    def samples(self) -> ShaftSamples:
        """Everything drained since the last call."""
        rows, self._rows = np.array(self._rows, np.float64).reshape(-1, 5), []
        return ShaftSamples(*rows.T.copy())

    def angle_at(self, now_s: float) -> float:
        """The angle carried on to now at the last speed."""
        return self.angle_rad + self.speed_rad_s * (now_s - self.at_s)

    @property
    def silent_s(self) -> float:
        """How long the drive has left unanswered what it was asked, as of the last `drain`."""
        return 0.0 if self._unanswered_s is None else max(self.drained_s - self._unanswered_s, 0.0)

    @property
    def motion_fault(self) -> str | None:
        """What is wrong with the reported motion, since `recount`."""
        return self._position.fault or self._speed.fault

    @property
    def zero_lost(self) -> str | None:
        """Why the angle is not to be believed any more; not forgiven."""
        return self._position.leap

    @property
    def form_fault(self) -> str | None:
        """That replies no longer carry what they carried since `recount`: an error would go unseen."""
        return (
            "replies lost their bytes for temperature and error; check the CAN wiring and what else talks on it" if self._is_cut else None
        )

    def missing(self) -> str | None:
        """Why there is no reply since `recount`, and what to do about it; None where there is one."""
        drive = self._settings.drive_id
        if self.heard:
            return None
        if drive in self._servo:
            return (
                f"drive {drive} sends status frames of servo mode; check that it is set to MIT mode (CubeMarsTool), or use cubemars-servo"
            )
        if self._masters:
            return f"drive {drive} replies under id {_listed(self._masters)}; check its master id, which must be 0 or its own"
        if self._foreign or self._servo:
            return f"frames of {_listed(self._foreign | self._servo)} but no reply from drive {drive}; check drive_id"
        return "no frames at all on the CAN bus; check the drive's power, the wiring, the termination and the bit rate (1 Mbit/s)"


def _listed(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))

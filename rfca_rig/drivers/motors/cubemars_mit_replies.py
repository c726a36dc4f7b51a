"""Receives the replies of one AK drive in MIT mode, and stamps each with the time of its request."""

from collections import deque
from collections.abc import Sequence

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_mit import MitReply, decode_reply, position_of
from rfca_rig.drivers.can_frames import BusHealth, receive_frames
from rfca_rig.drivers.motors.cubemars import CODES, MitSettings, SpeedCheck, WrappedPosition
from rfca_rig.drivers.roles import ShaftSamples

# A request open for longer than this counts as lost: a drive answers each frame at once.
RESYNC_S = 0.02
# Number of open requests that are kept, so that a silent drive costs no memory.
MAX_OPEN_REQUESTS = 64
# Margin in rad at the shaft, on top of the fastest possible motion, before a step counts as a jump.
JUMP_MARGIN_RAD = 0.3


class MitReplies:
    """Receives the replies of one drive. The drive answers each frame once and at once, so a reply shows the shaft at its request.

    `angle_rad` (continuous over turns), `speed_rad_s` and `torque_Nm` are those of the shaft at time `at_s`; `reply` is the last reply.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: MitSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        # 16 bits over the range -position_rad..position_rad.
        counts_per_rad = (CODES - 1) / (2.0 * settings.ranges.position_rad)
        fastest = settings.ranges.speed_rad_s * counts_per_rad
        self._position = WrappedPosition(frozenset({0, CODES - 1}), fastest, JUMP_MARGIN_RAD * counts_per_rad)
        self._speed = SpeedCheck("model: it decides the scale of the speed")
        self._asked_s: deque[float] = deque(maxlen=MAX_OPEN_REQUESTS)
        self._unanswered_s: float | None = None
        # Last time at which no request was open.
        self._whole_s = clock.now_s()
        self._first_s: float | None = None
        self._rows: list[tuple[float, ...]] = []
        self.drained_s = clock.now_s()
        self.reply: MitReply | None = None
        self.at_s = -np.inf
        self.angle_rad = self.speed_rad_s = self.torque_Nm = np.nan
        self.lost = 0
        self.health = BusHealth()
        self.reset_counters()

    def reset_counters(self) -> None:
        """Restarts the counters behind `missing`, and clears motion faults."""
        self._position.forgive()
        self._speed.forgive()
        self._foreign: set[int] = set()
        self._masters: set[int] = set()
        self._servo: set[int] = set()
        self.heard = 0
        # The next reply counts, even if its request has the same time as an older one.
        self.at_s = -np.inf
        self._reports_errors = self._is_cut = False

    def note_query(self) -> None:
        """Notes a frame sent to the drive: each one is answered."""
        if not self._asked_s:
            self._whole_s = self._clock.now_s()
        self._asked_s.append(self._clock.now_s())
        if self._unanswered_s is None:
            self._unanswered_s = self._clock.now_s()

    def drain(self) -> None:
        """Receives everything the bus holds; never waits. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        self.drained_s = self._clock.now_s()
        replies: list[MitReply] = []
        try:
            for message in receive_frames(self._bus, self.health):
                self._take(message, replies)
        finally:
            self._stamp(replies)

    def _take(self, message: can.Message, replies: list[MitReply]) -> None:
        identifier, data, drive = message.arbitration_id, message.data, self._settings.drive_id
        # Status frames of servo mode show that the drive is in the wrong mode, which `missing` reports.
        if message.is_extended_id:
            if identifier >> 8 == cubemars_servo.Packet.STATUS:
                self._servo.add(cubemars_servo.drive_of(identifier))
        elif not data:
            return
        elif identifier in {0, drive} and data[0] == drive:
            replies.append(decode_reply(self._settings.ranges, data))
        elif data[0] == drive:
            # A reply of this drive under a third id: its master id is set otherwise.
            self._masters.add(identifier)
        else:
            self._foreign.add(data[0] if identifier == 0 else identifier)

    def _stamp(self, replies: Sequence[MitReply]) -> None:
        times_s = self._assign_requests(len(replies))
        self.heard += len(replies)
        for reply, t_s in zip(replies[len(replies) - len(times_s) :], times_s, strict=True):
            self._follow(reply, t_s)

    def _assign_requests(self, count: int) -> list[float]:
        """Request times of `count` replies. They are matched in order, as a bus keeps it and a slow adapter may only delay replies.

        If a request has stayed open for `RESYNC_S`, a reply was lost; the newest replies then belong to the newest requests.
        """
        requests_s = list(self._asked_s)
        is_lost = 0 < count < len(requests_s) and self.drained_s - self._whole_s > RESYNC_S
        answered_s, open_s = (requests_s[-count:], []) if is_lost else (requests_s[:count], requests_s[count:])
        self.lost += len(requests_s) - count if is_lost else 0
        if count:
            self._asked_s = deque(open_s, MAX_OPEN_REQUESTS)
            self._unanswered_s = open_s[0] if open_s else None
        if not self._asked_s:
            self._whole_s = self.drained_s
        return answered_s

    def _follow(self, reply: MitReply, t_s: float) -> None:
        self.reply = reply
        self._is_cut |= self._reports_errors and reply.error is None
        self._reports_errors |= reply.error is not None
        if t_s <= self.at_s:
            # Two requests at the same time: the second reply is the same.
            return
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
        """Samples (m,) drained since the last call."""
        rows, self._rows = np.array(self._rows, np.float64).reshape(-1, 5), []
        return ShaftSamples(*rows.T.copy())

    def angle_at(self, now_s: float) -> float:
        """Shaft angle in rad, extrapolated to `now_s` at the last speed."""
        return self.angle_rad + self.speed_rad_s * (now_s - self.at_s)

    @property
    def silent_s(self) -> float:
        """Time in s for which a request has been unanswered, at the last `drain`."""
        return 0.0 if self._unanswered_s is None else max(self.drained_s - self._unanswered_s, 0.0)

    @property
    def motion_fault(self) -> str | None:
        """An error of the reported motion since `reset_counters`, or None."""
        return self._position.fault or self._speed.fault

    @property
    def zero_lost(self) -> str | None:
        """Why the angle can no longer be trusted, or None. Never reset."""
        return self._position.leap

    @property
    def form_fault(self) -> str | None:
        """Set if replies have lost the error byte that they carried since `reset_counters`: an error would stay hidden."""
        return (
            "replies lost their bytes for temperature and error; check the CAN wiring and what else talks on it" if self._is_cut else None
        )

    def missing(self) -> str | None:
        """Why there is no reply since `reset_counters`, and the remedy; None if there is one."""
        drive = self._settings.drive_id
        if self.heard:
            return None
        if drive in self._servo:
            return (
                f"drive {drive} sends status frames of servo mode; check that it is set to MIT mode (CubeMarsTool), or use cubemars-servo"
            )
        if self._masters:
            return f"drive {drive} replies under id {_join_numbers(self._masters)}; check its master id, which must be 0 or its own"
        if self._foreign or self._servo:
            return f"frames of {_join_numbers(self._foreign | self._servo)} but no reply from drive {drive}; check drive_id"
        return "no frames at all on the CAN bus; check the drive's power, the wiring, the termination and the bit rate (1 Mbit/s)"


def _join_numbers(numbers: set[int]) -> str:
    return ", ".join(map(str, sorted(numbers)))

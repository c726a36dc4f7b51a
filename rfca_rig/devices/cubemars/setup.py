"""Settings of CubeMars / T-Motor AK drives. Over CAN they can be seen in part, and none can be
written but the zero: the lines are for the maker's tool on its serial adapter (R-Link).
"""

from collections.abc import Sequence
from dataclasses import replace

import can

from rfca_rig.clock import Clock
from rfca_rig.devices.checks import Finding, Listener, ReceivedFrame
from rfca_rig.devices.cubemars.checks import (
    ANSWER_S,
    WARNING_PERIOD_RATIO,
    judge_mit,
    judge_servo,
    look_for_mit,
    look_for_servo,
)
from rfca_rig.devices.cubemars.codec import error_text, mit_ranges
from rfca_rig.devices.cubemars.codec.mit import Special, encode_special
from rfca_rig.devices.cubemars.driver import MAX_MIT_ID
from rfca_rig.devices.cubemars.section import CubemarsMitSection, CubemarsServoSection
from rfca_rig.devices.cubemars.tool_fields import (
    BITRATE,
    CAN_ID,
    FEEDBACK_RATE,
    MIT_MODE,
    PERIODIC,
    SERVO_MODE,
)
from rfca_rig.devices.drive_setup import ON_OFF, DriveNeeds, DriveSetup, Setting
from rfca_rig.errors import BadInput, DeviceError

# Between two questions of a search for the id of a drive.
SEARCH_STEP_S = 2e-3
GUARDIAN = (
    "no setting of it ends the torque when commands stop: in a run a guardian holds the bus "
    "(docs/guardian.md)"
)
NOTHING_TO_WRITE = "an AK drive takes no settings over CAN: use the lines of --print in its tool"


class CubemarsSetup(DriveSetup):
    """What both modes share: nothing is written, and the lines are for a window of the tool."""

    def __init__(self, bus: can.BusABC, clock: Clock, needs: DriveNeeds) -> None:
        if needs.maker_file is not None:
            raise BadInput(
                f"{needs.maker_file}: an AK drive has no endpoints; leave --endpoints out"
            )
        self._listener = Listener(bus, clock)
        self._lines: tuple[str, ...] = ()

    def describe(self) -> tuple[str, ...]:
        return self._lines

    def write(self, settings: Sequence[Setting]) -> None:  # noqa: ARG002 (it takes none)
        raise DeviceError(NOTHING_TO_WRITE)

    def save(self) -> None:
        raise DeviceError(NOTHING_TO_WRITE)

    def list_lines(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        """Fields of the tool's page "Application Settings", and what to enter."""
        lines = []
        for setting in settings:
            if setting.unit == ON_OFF:
                lines.append(f"{setting.name} = {'on' if setting.wanted else 'off'}")
            elif setting.wanted is not None:
                lines.append(f"{setting.name} = {setting.wanted:.7g} {setting.unit}".rstrip())
        return (*lines, "save")

    def _tell(self, settings: Sequence[Setting], actual: dict[str, float]) -> tuple[Setting, ...]:
        if self._listener.failed is not None:
            raise DeviceError(f"the CAN bus failed: {self._listener.failed}")
        return tuple(replace(setting, actual=actual.get(setting.name)) for setting in settings)


class CubemarsMitSetup(CubemarsSetup):
    """A drive in MIT mode. It answers only when asked; of all frames only the one that ends the
    mode, and with it the torque, can ask.
    """

    def __init__(
        self, keys: CubemarsMitSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
    ) -> None:
        super().__init__(bus, clock, needs)
        self._keys = keys

    def list_wanted(self) -> tuple[Setting, ...]:
        return (
            _bitrate(self._keys.bitrate),
            Setting(CAN_ID, "its number on the bus", self._keys.drive_id, None, "", False),
            Setting(MIT_MODE, "position, speed, gains and torque", 1.0, None, ON_OFF, False),
        )

    def read(self) -> tuple[Setting, ...]:
        """Asks the drive, unless others speak on the bus; where it does not answer, any id."""
        drive_id = self._keys.drive_id
        ranges = mit_ranges(self._keys.model)
        seen = look_for_mit(self._listener, drive_id, ranges)
        if seen.reply is None and seen.asked and not (seen.others or seen.servo or seen.masters):
            drive_id = self._search() or drive_id
            seen = look_for_mit(self._listener, drive_id, ranges)
        if seen.reply is None:
            raise DeviceError(_in_words(judge_mit(seen, drive_id)[0]))
        reply = self._listener.frames[-1].message
        words = [
            f"AK drive {drive_id} in MIT mode",
            f"replies of {reply.dlc} bytes under id {reply.arbitration_id}",
        ]
        if seen.reply.temperature_degC is not None:
            words.append(f"{seen.reply.temperature_degC} degC")
        if seen.reply.error:
            words.append(error_text(seen.reply.error))
        self._lines = (*_drive_lines(words, drive_id, self._keys.drive_id), GUARDIAN)
        actual = {BITRATE: float(self._keys.bitrate), CAN_ID: float(drive_id), MIT_MODE: 1.0}
        return self._tell(self.list_wanted(), actual)

    def _search(self) -> int | None:
        """The id of a drive that answers; None if there is none."""
        for drive_id in range(1, MAX_MIT_ID + 1):
            self._listener.ask(
                can.Message(
                    arbitration_id=drive_id, data=encode_special(Special.EXIT), is_extended_id=False
                )
            )
            replies = self._listener.listen(SEARCH_STEP_S)
            if replies:
                return _sender(replies[0])
        replies = self._listener.listen(ANSWER_S)
        if replies:
            return _sender(replies[0])
        return None


class CubemarsServoSetup(CubemarsSetup):
    """A drive in servo mode, which sends its status by itself. It is only listened to."""

    def __init__(
        self, keys: CubemarsServoSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
    ) -> None:
        super().__init__(bus, clock, needs)
        self._keys = keys

    def list_wanted(self) -> tuple[Setting, ...]:
        rate_Hz = 1e3 / self._keys.status_period_ms
        return (
            _bitrate(self._keys.bitrate),
            Setting(CAN_ID, "its number on the bus", self._keys.drive_id, None, "", False),
            Setting(SERVO_MODE, "position and speed loops in the drive", 1.0, None, ON_OFF, False),
            Setting(PERIODIC, "it reports without being asked", 1.0, None, ON_OFF, False),
            Setting(
                FEEDBACK_RATE,
                "reports angle, speed and torque: status_period_ms",
                rate_Hz,
                None,
                "Hz",
                False,
                rate_Hz / WARNING_PERIOD_RATIO,
                rate_Hz * WARNING_PERIOD_RATIO,
            ),
        )

    def read(self) -> tuple[Setting, ...]:
        """Listens for a second, to the only other drive where that of the rig file is silent."""
        drive_id = self._keys.drive_id
        seen = look_for_servo(self._listener, drive_id)
        if seen.status is None and len(seen.others) == 1:
            drive_id = seen.others[0]
            seen = look_for_servo(self._listener, drive_id)
        if seen.status is None:
            finding = judge_servo(seen, drive_id, self._keys.status_period_ms / 1e3)[0]
            raise DeviceError(_in_words(finding))
        words = [
            f"AK drive {drive_id} in servo mode",
            f"{seen.status.temperature_degC} degC",
        ]
        if seen.status.error:
            words.append(error_text(seen.status.error))
        self._lines = (*_drive_lines(words, drive_id, self._keys.drive_id), GUARDIAN)
        actual = {
            BITRATE: float(self._keys.bitrate),
            CAN_ID: float(drive_id),
            SERVO_MODE: 1.0,
            PERIODIC: 1.0,
        }
        if seen.period_s is not None:
            actual[FEEDBACK_RATE] = float(round(1.0 / seen.period_s))
        return self._tell(self.list_wanted(), actual)


def _bitrate(bits_per_s: int) -> Setting:
    return Setting(BITRATE, "bits/s of the bus", float(bits_per_s), None, "bit/s", False)


def _sender(reply: ReceivedFrame) -> int:
    """The drive's id is the first byte of its reply, whatever the id of the frame."""
    return reply.message.data[0]


def _drive_lines(words: Sequence[str], drive_id: int, wanted_id: int) -> list[str]:
    lines = [", ".join(words)]
    if drive_id != wanted_id:
        lines.append(f"drive {drive_id} answers, the rig file has {wanted_id}")
    return lines


def _in_words(finding: Finding) -> str:
    return f"{finding.seen}; {finding.fix}"


def make_mit_setup(
    keys: CubemarsMitSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
) -> CubemarsMitSetup:
    """The settings of the drive in MIT mode that [motor] names."""
    return CubemarsMitSetup(keys, bus, clock, needs)


def make_servo_setup(
    keys: CubemarsServoSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
) -> CubemarsServoSetup:
    """The settings of the drive in servo mode that [motor] names."""
    return CubemarsServoSetup(keys, bus, clock, needs)

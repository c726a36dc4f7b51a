"""Settings of a moteus: addresses, gear, direction, zero, and the timeout of its commands."""

from dataclasses import dataclass

from rfca_rig.codecs.moteus import LARGEST_ID, LARGEST_PREFIX
from rfca_rig.drivers.shaft_gear import ShaftGear, check_positive
from rfca_rig.errors import BadInput

# The vendor's tools use source id 0, and answers go to the id that asked.
OWN_ID = 0x20


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
        self._check_addresses()
        self.check_gear()
        for name in ("watchdog_s", "reply_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_limit_Nm is not None:
            check_positive("torque_limit_Nm", self.torque_limit_Nm)

    def _check_addresses(self) -> None:
        if not 1 <= self.drive_id <= LARGEST_ID:
            raise BadInput(f"drive: drive_id is {self.drive_id}, must be 1..{LARGEST_ID}")
        if not 0 <= self.own_id <= LARGEST_ID or self.own_id == self.drive_id:
            raise BadInput(f"drive: own_id is {self.own_id}, must be 0..{LARGEST_ID} and not the drive's")
        if not 0 <= self.can_prefix <= LARGEST_PREFIX:
            raise BadInput(f"drive: can_prefix is {self.can_prefix}, must be 0..{LARGEST_PREFIX}")

"""Settings of an ODrive: address, gear, direction, zero and message rates."""

from dataclasses import dataclass

from rfca_rig.codecs.odrive_messages import OdriveFirmware
from rfca_rig.drivers.shaft_gear import ShaftGear, check_positive
from rfca_rig.errors import BadInput


@dataclass(frozen=True)
class OdriveSettings(ShaftGear):
    """Settings of the drive.

    `gear_ratio` is motor turns per shaft turn, `direction` +1 or -1, `zero_turns` the encoder reading in turns with the shaft
    horizontal. With `torque_constant_Nm_per_A` None the torque comes from message 0x1C, else from the measured current 0x14.
    `encoder_period_s` is the drive's cyclic period of message 0x09. `dialect` is that of its firmware; 0.5 reports no torque, so it
    needs the torque constant. Raises BadInput for invalid values.
    """

    node_id: int
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    torque_constant_Nm_per_A: float | None = None
    encoder_period_s: float = 1e-3
    # Longer than three heartbeat periods of 0.1 s.
    heartbeat_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0
    dialect: OdriveFirmware = OdriveFirmware.V0_6

    def __post_init__(self) -> None:
        # Six bits of the arbitration id hold the node; 63 is the broadcast address of drives without one.
        if not 0 <= self.node_id < 63:
            raise BadInput(f"drive: node_id is {self.node_id}, must be 0..62")
        self.check_gear()
        for name in ("encoder_period_s", "heartbeat_timeout_s", "enable_timeout_s"):
            check_positive(name, getattr(self, name))
        if self.torque_constant_Nm_per_A is not None:
            check_positive("torque_constant_Nm_per_A", self.torque_constant_Nm_per_A)
        # Message 0x1C exists only in firmware 0.6; without it the torque has to come from the current.
        elif self.dialect == OdriveFirmware.V0_5:
            raise BadInput(
                "drive: torque_constant_Nm_per_A is missing; firmware 0.5 tells the motor's current, not its torque "
                "(8.27 / the motor's KV in rpm/V, as in motor.config.torque_constant)"
            )

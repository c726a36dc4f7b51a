"""Tests away from the experiments: what each of them decides, whatever the leg does."""

from collections.abc import Collection
from dataclasses import dataclass

CERTAIN = 10.0  # log evidence that such a test gives, enough for any purpose


@dataclass(frozen=True)
class OffRigTest:
    """`decides` are the effects whose presence it shows; `minutes` what it takes; `how` in a few words."""

    kind: str
    minutes: float
    decides: frozenset[str]
    how: str

    def separates(self, one: Collection[str], other: Collection[str]) -> bool:
        """Whether it would come out differently under two sets of effects."""
        return self.decides & set(one) != self.decides & set(other)


OFF_RIG = (
    OffRigTest(
        "known weight on each axis",
        20.0,
        frozenset({"sensor_gain", "sensor_crosstalk"}),
        "hang a known weight on the sensor along each axis and compare all channels",
    ),
    OffRigTest(
        "tap test",
        15.0,
        frozenset({"sensor_lag", "clock_offset", "frame_compliance"}),
        "tap the sensor and its frame with the motor held, record fast: a lag rounds the tap, a clock only shifts it, a frame rings",
    ),
    OffRigTest(
        "rest pose",
        15.0,
        frozenset({"gravity_tilt", "ground_tilt"}),
        "put a spirit level on rig and floor, and record the hanging leg at rest at three shaft angles",
    ),
    OffRigTest("zero before and after", 10.0, frozenset({"sensor_drift"}), "record the sensor without load before and after a run"),
    OffRigTest("gauge block", 10.0, frozenset({"height_offset"}), "measure the shaft's height above the plate with a gauge block"),
    OffRigTest("weighing", 20.0, frozenset({"tip_mass", "added_mass"}), "take the leg off and weigh it link by link"),
    OffRigTest(
        "weight on a lever",
        20.0,
        frozenset({"torque_scale"}),
        "hold a known weight on a level lever with the motor and compare its moment with the recorded torque",
    ),
    OffRigTest(
        "blocked step",
        15.0,
        frozenset({"torque_delay", "torque_lag"}),
        "block the link against a force gauge, step the torque and compare the two in time",
    ),
    OffRigTest(
        "bench pull",
        30.0,
        frozenset({"stiffness_hardening", "damaged_hinge", "hinge_backlash", "hinge_stop"}),
        "clamp the leg hinge by hinge and read the angle under known weights",
    ),
)

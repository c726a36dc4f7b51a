"""Tests on the bench that show whether an effect is present, whatever the rig does.

An effect declares the kind of the test that shows it.
"""

# Kind, usual minutes of a person, and how
BENCH_TESTS = (
    (
        "known weight on each axis",
        20.0,
        "hang a known weight on the sensor along each axis and compare all channels",
    ),
    (
        "tap test",
        15.0,
        (
            "tap the sensor and its frame with the motor held, record fast: a lag rounds the "
            "tap, a clock only shifts it, a frame rings"
        ),
    ),
    (
        "straightedge",
        10.0,
        (
            "lay a straightedge over the plate along the way of the tip and measure the gaps "
            "with feeler gauges"
        ),
    ),
    (
        "rest pose",
        15.0,
        (
            "put a spirit level on rig and floor, and record the hanging leg at rest at three"
            " shaft angles"
        ),
    ),
    (
        "zero before and after",
        10.0,
        "record the sensor without load before and after a run",
    ),
    (
        "gauge block",
        10.0,
        "measure the shaft's height above the plate with a gauge block",
    ),
    (
        "weighing",
        20.0,
        "take the leg off and weigh it link by link",
    ),
    (
        "weighing a body",
        20.0,
        "weigh the bodies with all that is mounted on them, or hold the arm level on a scale",
    ),
    (
        "balancing",
        20.0,
        "take the links off and balance each on an edge",
    ),
    (
        "blocked joint",
        15.0,
        (
            "block each link, push both ways with its motor and read the encoder: elasticity "
            "is a slope over the torque, play a step at zero"
        ),
    ),
    (
        "weight on a lever",
        20.0,
        (
            "hold a known weight on a level lever with the motor and compare its moment with "
            "the recorded torque"
        ),
    ),
    (
        "blocked step",
        15.0,
        "block the link against a force gauge, step the torque and compare the two in time",
    ),
    (
        "unloaded leg",
        10.0,
        (
            "take the leg off, lay it on its side on a smooth table, and read the angle of "
            "each hinge without load"
        ),
    ),
    (
        "bench pull",
        30.0,
        "clamp the leg hinge by hinge and read the angle under known weights",
    ),
)

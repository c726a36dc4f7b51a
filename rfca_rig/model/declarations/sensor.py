"""Effects on readings. Those of a leg's force sensor act on fy, fz and tx together; a mechanism may
have several sensors.
"""

from dataclasses import replace

from rfca_rig.model.effect import Declaration

SENSOR_GAIN = Declaration(
    id="sensor_gain",
    where="sensor",
    left_out="force scale wrong",
    law="all channels times a factor",
    source="calibration",
    families=("sensor_scale",),
    bench_test="known weight on each axis",
)

SENSOR_GAIN_OF_MECHANISM = replace(
    SENSOR_GAIN,
    where="readings",
    left_out="scale of the sensors wrong",
    law="y = factor x",
    single="sensor",
)

SENSOR_CROSSTALK_MATRIX = Declaration(
    id="sensor_crosstalk_matrix",
    where="sensor",
    left_out="channels leak into each other",
    law="(fy, fz, tx) times a matrix with ones on its diagonal; no leak of tx",
    source=(
        "off-diagonal terms of the calibration matrix; tx_per_fz is also a sensor beside the "
        "shaft, tx_per_fy one of another height"
    ),
    families=("sensor_scale",),
    bench_test="known weight on each axis",
)

SENSOR_CROSSTALK = Declaration(
    id="sensor_crosstalk",
    where="sensor",
    left_out="fy leaks into fz",
    law="fz + c fy",
    source="off-diagonal term of the calibration matrix",
    families=("sensor_scale",),
    variant_of=SENSOR_CROSSTALK_MATRIX.id,
    bench_test="known weight on each axis",
)

SENSOR_CROSSTALK_OF_MECHANISM = replace(
    SENSOR_CROSSTALK,
    where="readings",
    left_out="one value of the sensors leaks into another",
    law="y_1 = x_1 + share x_2 (rms y_1 / rms y_2)",
    variant_of="",
)

SENSOR_SATURATION = Declaration(
    id="sensor_saturation",
    where="sensor",
    left_out="fz is cut off at a limit",
    law="fz between -limit and limit",
    source="range of an amplifier or of its converter",
    families=("sensor_scale",),
    bench_test="known weight on each axis",
)

SENSOR_DRIFT = Declaration(
    id="sensor_drift",
    where="sensor",
    left_out="fz drifts with time",
    law="fz + rate t",
    source="thermal drift of a strain-gauge bridge",
    families=("sensor_zero",),
    # The sensor is tared at each stage.
    in_motion_only=True,
    bench_test="zero before and after",
)

SENSOR_DRIFT_OF_MECHANISM = replace(
    SENSOR_DRIFT,
    where="readings",
    left_out="the zero of the sensors drifts with time",
    law="y = x + rate t",
    source="-",
)

SENSOR_LAG = Declaration(
    id="sensor_lag",
    where="sensor",
    left_out="first-order lag of all channels",
    law="tau y' = x - y",
    source="first-order low-pass",
    families=("sensor_late",),
    in_motion_only=True,
    bench_test="tap test",
)

SENSOR_LAG_OF_MECHANISM = replace(
    SENSOR_LAG,
    where="readings",
    left_out="the sensors are read later than the joints: a filter",
    law="T y' = x - y",
)

SENSOR_RINGING = Declaration(
    id="sensor_ringing",
    where="sensor",
    left_out="the sensor swings under its load",
    law="y'' + 2 d w y' + w^2 y = w^2 x for every channel, at rest before the first sample",
    source=(
        "one mode of vibration of the sensor with what is bolted to it: Ewins, Modal Testing, 2000"
    ),
    families=("sensor_late",),
    in_motion_only=True,
    bench_test="tap test",
)

CLOCK_OFFSET = Declaration(
    id="clock_offset",
    where="sensor",
    left_out="force and shaft clocks apart",
    law="force(t) = true force(t - offset)",
    source="-",
    families=("sensor_late",),
    in_motion_only=True,
    bench_test="tap test",
)

CLOCK_OFFSET_OF_MECHANISM = replace(
    CLOCK_OFFSET,
    where="readings",
    left_out="the clocks of sensors and joints differ",
    law="y(t) = x(t - offset)",
    source="two clocks",
)

SENSOR_CLOCK_RATE = Declaration(
    id="sensor_clock_rate",
    where="sensor",
    left_out="the force clock runs fast or slow",
    law="force(t) = true force(t - rate t), t from the beginning of the motion",
    source="-",
    families=("sensor_late",),
    in_motion_only=True,
    bench_test="tap test",
)

ANGLE_LAG = Declaration(
    id="angle_lag",
    where="readings",
    left_out="positions and speeds of the joints are read late",
    law="T y' = x - y",
    source="first-order low-pass",
)

SPEED_LAG = Declaration(
    id="speed_lag",
    where="readings",
    left_out="speeds are read later than the positions",
    law="T y' = x - y for speeds alone",
    source="first-order low-pass",
)

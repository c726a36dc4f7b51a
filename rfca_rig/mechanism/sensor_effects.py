"""Effects of force sensors and other sensors on their readings."""

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from rfca_rig.mechanism.laws import PlaceLaw, expand_law, join_name
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.effect import Effect, Parameter, Values

# Share of a value's rms that another one may add to it: more than in any sensor that was calibrated at all.
LEAKS = 0.5
DRIFTS_BY = 0.3  # of a sensor's rms, per second: a larger drift is visible without a model


def list_sensor_effects(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Lists the effects of sensors on their readings; positions of joints are the reference for their clock."""

    def lag(plant: Plant, values: Values) -> Plant:
        plant.sensor_lag_s = values["time_constant_s"]
        return plant

    def delay(plant: Plant, values: Values) -> Plant:
        plant.sensor_delay_s += values["offset_s"]
        return plant

    if not usual.sensors:
        return
    names = tuple(usual.sensors)
    places = tuple(mechanism.sensor_values[name][0] for name in names)
    one = np.ones(len(places))
    yield from expand_law(
        PlaceLaw("sensor_gain", "scale of the sensors wrong", "y = factor x", "calibration", "factor", ("",) * len(places), names,
             places, 0.5 * one, 2.0 * one, _scale_sensor, "sensor")
    )  # fmt: skip
    yield from _sensor_crosstalk(mechanism, usual)
    yield _sensor_drift(mechanism, usual)
    yield Effect("sensor_lag", "readings", "the sensors are read later than the joints: a filter", "T y' = x - y", "first-order low-pass",
                 (Parameter("time_constant_s", 0.002, 0.05, may_be_zero=False, below=0.1),), lag)  # fmt: skip
    yield Effect("clock_offset", "readings", "the clocks of sensors and joints differ", "y(t) = x(t - offset)", "two clocks",
                 (Parameter("offset_s", -0.04, 0.04, below=0.1),), delay)  # fmt: skip


def _sensor_crosstalk(mechanism: Mechanism, usual: UsualMotion) -> Iterator[Effect]:
    """Crosstalk: a share of one recorded value in the reading of another; a number selects the pair."""
    pairs = list(permutations(usual.sensors, 2))

    def leak(plant: Plant, values: Values) -> Plant:
        to, source = pairs[int(values["pair"]) - 1]
        # The values may have different units, so the share refers to their usual magnitudes.
        scale = usual.sensors[to] / max(usual.sensors[source], 1e-12)
        plant.sensor_crosstalk[mechanism.sensor_values[to][0], mechanism.sensor_values[source][0]] += values["share_relative"] * scale
        return plant

    if pairs:
        listed = ", ".join(f"{number}: {to} reads {source}" for number, (to, source) in enumerate(pairs, start=1))
        pair = Parameter("pair", 1.0, float(len(pairs)), may_be_zero=False, whole=True)
        share = Parameter("share_relative", -LEAKS, LEAKS, starts=(-0.2 * LEAKS, 0.2 * LEAKS))
        yield Effect("sensor_crosstalk", "readings", "one value of the sensors leaks into another",
                     f"y_1 = x_1 + share x_2 (rms y_1 / rms y_2); pairs {listed}", "off-diagonal term of the calibration matrix",
                     (pair, share), leak)  # fmt: skip


def _sensor_drift(mechanism: Mechanism, usual: UsualMotion) -> Effect:
    rates = {}
    for name, rms in usual.sensors.items():
        place, unit = mechanism.sensor_values[name]
        key = join_name(name if len(usual.sensors) > 1 else "", "rate", unit.replace(" ", "").replace("/", "_"), "per_s")
        rates[key] = place, DRIFTS_BY * max(rms, 1e-12)

    def apply(plant: Plant, values: Values) -> Plant:
        for key, (place, _) in rates.items():
            plant.sensor_drift_per_s[place] += values[key]
        return plant

    parameters = tuple(Parameter(key, -largest, largest) for key, (_, largest) in rates.items())
    return Effect("sensor_drift", "readings", "the zero of the sensors drifts with time", "y = x + rate t", "-", parameters, apply)


def _scale_sensor(plant: Plant, place: int, value: float) -> None:
    plant.sensor_gain[place] *= value

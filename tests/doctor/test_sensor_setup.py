"""Axes, counts and levers from pushes and a mass, judged as if they had been measured."""

import numpy as np
import pytest

from rfca_rig.bench.sensor_bench import open_sensor
from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.description.rig_file import MountedSensorSection, read_rig
from rfca_rig.doctor.sensor_setup import (
    AXES,
    BELOW_SHAFT,
    CHECK,
    LEVER,
    MASS,
    PUSHES,
    SimulatedHand,
    find_axes,
    hang_mass,
    judge_axes,
    judge_last_check,
    judge_mounting,
    measure_loads,
)
from rfca_rig.errors import DeviceError
from rfca_rig.twin_server.faults import parse_fault_events
from rfca_rig.twin_server.sensor_mount import load_at_point
from tests.bench.test_force_sensors import SECTIONS, written
from tests.doctor.said import whole
from tests.engine.rigs import ROOT

BELOW_M = 0.045
STRAIGHT = SensorAxes()
TWIN = ROOT / "calibration" / "twin.toml"


def loads(mass, axes=STRAIGHT, matrix=None, below_m=BELOW_M):
    """What the sensor reads of pushes of 20 N and of the mass; `matrix` (6, 6) acts in it."""
    at_shaft = np.array([0.0, 0.0, -below_m])
    pushes = {}
    for step in PUSHES:
        pushes[step.name] = load_at_point(20.0 * np.array(step.direction), at_shaft)
    at_mass = at_shaft + np.array([0.0, mass.lever_m, 0.0])
    pushes[mass.name] = load_at_point(np.array([0.0, 0.0, mass.mass_kg * 9.80665]), at_mass)
    matrix = np.eye(6) if matrix is None else matrix
    return {name: matrix @ axes.to_device(load[None, :])[0] for name, load in pushes.items()}


def judged(mass=None, stated=STRAIGHT, **read):
    mass = mass or hang_mass(1.0, 100.0)
    return judge_mounting(loads(mass, **read), mass, stated, 1e3 * BELOW_M)


def by_subject(check):
    return {finding.subject: finding for finding in check.findings}


def diagonal(*factors):
    return np.diag(np.array(factors, float))


@pytest.mark.parametrize("lever_mm", [0.0, 100.0, -150.0])
def test_a_right_sensor_is_all_green(lever_mm):
    check = judged(hang_mass(1.0, lever_mm))
    assert {name: str(finding.colour) for name, finding in by_subject(check).items()} == (
        dict.fromkeys((AXES, MASS, LEVER, BELOW_SHAFT), "green")
    )
    assert check.below_shaft_mm == pytest.approx(45.0)
    assert check.mass_N == pytest.approx(9.80665)


@pytest.mark.parametrize(
    "names", [("-y", "x", "z"), ("-x", "-y", "z"), ("-x", "y", "-z"), ("y", "z", "x")]
)
def test_another_mounting_is_found_and_all_else_judged_in_it(names):
    check = judged(axes=SensorAxes(names))
    findings = by_subject(check)
    assert check.axes == SensorAxes(names)
    assert findings[AXES].colour == "yellow"
    assert f"axes = {SensorAxes(names)} under [sensor]" in whole(findings[AXES])
    assert {str(findings[name].colour) for name in (MASS, LEVER, BELOW_SHAFT)} == {"green"}
    # Once the rig file says so, it is green.
    assert by_subject(judged(axes=SensorAxes(names), stated=SensorAxes(names)))[AXES].colour == (
        "green"
    )


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (diagonal(-1, 1, 1, 1, -1, -1), "fx has the wrong sign"),
        (diagonal(1, 1, -1, 1, 1, 1), "fz has the wrong sign"),
        (np.eye(6)[[1, 0, 2, 3, 4, 5]], "fx and fy are swapped"),
        (np.eye(6)[[0, 2, 1, 3, 4, 5]], "fy and fz are swapped"),
        (diagonal(-1, -1, -1, 1, 1, 1), "a channel has the wrong sign, or two are swapped"),
    ],
)
def test_what_no_mounting_gives_is_red_and_named(matrix, words):
    check = judged(matrix=matrix)
    (finding,) = check.findings
    assert finding.colour == "red"
    assert "mirrored, left-handed" in finding.seen
    assert words in finding.seen
    assert check.axes is None


@pytest.mark.parametrize(
    ("read", "subject", "words"),
    [
        ({"matrix": diagonal(1.2, 1.2, 1.2, 1, 1, 1)}, MASS, "+20.0 %"),
        (
            {"matrix": diagonal(*3 * [1 / 4.44822], 1, 1, 1)},
            MASS,
            "as if the sensor counted in lbf",
        ),
        (
            {"matrix": diagonal(*3 * [4.44822], 1, 1, 1)},
            MASS,
            "as if the rig file had counts per lbf",
        ),
        ({"matrix": diagonal(2, 2, 2, 2, 2, 2)}, MASS, "as of a calibration of another range"),
        ({"matrix": diagonal(1, 1, 1, 8.85, 8.85, 8.85)}, LEVER, "a lever of 885 mm for 100"),
        ({"matrix": diagonal(1, 1, 1, -1, 1, 1)}, LEVER, "tx has the wrong sign"),
        ({"matrix": diagonal(1, 1, 1, -1, 1, 1)}, BELOW_SHAFT, "tx has the wrong sign"),
        ({"matrix": np.eye(6)[[0, 1, 2, 4, 3, 5]]}, BELOW_SHAFT, "tx and ty are swapped"),
        ({"below_m": 0.07}, BELOW_SHAFT, "gives 70 mm (tx / fy), the rig file says 45"),
    ],
)
def test_wrong_counts_moments_and_distances_are_red_and_named(read, subject, words):
    finding = by_subject(judged(**read))[subject]
    assert finding.colour == "red"
    assert words in finding.seen


def test_a_push_beside_every_axis_is_no_answer():
    mass = hang_mass(1.0, 0.0)
    turned = loads(mass)
    angle = np.radians(40.0)
    turn = np.eye(6)
    for at in (0, 3):
        turn[at : at + 2, at : at + 2] = [
            [np.cos(angle), np.sin(angle)],
            [-np.sin(angle), np.cos(angle)],
        ]
    turned = {name: turn @ load for name, load in turned.items()}
    finding = judge_axes(find_axes(turned), STRAIGHT)
    assert finding.colour == "red"
    assert "the push along x is 40 degrees beside" in finding.seen
    assert "tool transformation" in finding.fix


def test_two_pushes_along_one_axis_are_no_answer():
    mass = hang_mass(1.0, 0.0)
    pushed = loads(mass)
    pushed["x"] = pushed["y"]
    finding = judge_axes(find_axes(pushed), STRAIGHT)
    assert (finding.colour, "two along one axis" in finding.seen) == ("red", True)


def test_a_mass_that_pulls_aside_is_yellow():
    mass = hang_mass(1.0, 0.0)
    pushed = loads(mass)
    pushed["mass"][0] = 1.5
    finding = by_subject(judge_mounting(pushed, mass, STRAIGHT, 45.0))[MASS]
    assert (finding.colour, "9 degrees beside z" in finding.seen) == ("yellow", True)


@pytest.mark.parametrize("seed", range(20))
def test_a_right_sensor_with_noise_has_no_finding(seed):
    """On the twin, with pushes as far beside the axes as those of a person."""
    rig = read_rig(TWIN)
    mass = hang_mass(1.0, 100.0 * (seed % 2))
    with open_sensor(rig, seed) as bench:
        hand = SimulatedHand(bench.load, BELOW_M, np.random.default_rng([seed, 3]))
        measured = measure_loads(bench.sensor, bench.clock, hand, (*PUSHES, mass))
        findings = (*bench.settings, *judge_mounting(measured, mass, STRAIGHT, 45.0).findings)
    assert [finding for finding in findings if finding.colour != "green"] == []


@pytest.mark.parametrize("device", SECTIONS)
@pytest.mark.parametrize("fault", [None, "sensor-turned-90", "channel-inverted", "sensor-gain"])
def test_sensors_of_every_make_are_set_up_by_it(tmp_path, device, fault):
    """A serial sensor has 250 records a second of 0.05 N each; its push is found as well."""
    rig = read_rig(written(tmp_path, device))
    mass = hang_mass(1.0, 0.0)
    faults = []
    if fault is not None:
        faults = parse_fault_events([f"{fault}@0"])
    with open_sensor(rig, 1, faults) as bench:
        hand = SimulatedHand(bench.load, BELOW_M, np.random.default_rng([1, 3]))
        measured = measure_loads(bench.sensor, bench.clock, hand, (*PUSHES, mass))
    findings = judge_mounting(measured, mass, STRAIGHT, 45.0).findings
    named = [finding.subject for finding in findings if finding.colour != "green"]
    expected = {None: [], "sensor-gain": [MASS]}
    assert named == expected.get(fault, [AXES])


class NoHand:
    def apply(self, step):
        """Nobody pushes."""

    def release(self):
        """Nobody lets go."""


def test_a_push_that_does_not_come_is_said_with_what_was_felt():
    with open_sensor(read_rig(TWIN), 1) as bench:
        with pytest.raises(DeviceError, match=r"no load within 120 s .*change was 0\.\d\d N"):
            measure_loads(bench.sensor, bench.clock, NoHand(), PUSHES)
        # The stream has ended.
        bench.clock.wait_until(bench.clock.now_s() + 0.1)
        assert len(bench.sensor.read().counts) == 0


class SlowlyReleased:
    """A load that takes a second to go away, from a share below that of a hand that has let go."""

    def __init__(self) -> None:
        self.clock = None
        self._full = np.zeros(6)
        self._since_s = None

    @property
    def wrench(self):
        if self._since_s is None:
            return self._full
        return self._full * max(0.0, 0.29 - 0.29 * (self.clock.now_s() - self._since_s))

    def apply(self, step):
        self._since_s = None
        self._full = load_at_point(30.0 * np.array(step.direction), np.array([0.0, 0.0, -BELOW_M]))

    def release(self):
        self._since_s = self.clock.now_s()


def test_a_hand_that_comes_off_slowly_does_not_shift_the_next_push(monkeypatch):
    load = SlowlyReleased()
    monkeypatch.setattr("rfca_rig.bench.sensor_bench.SimulatedLoad", lambda: load)
    with open_sensor(read_rig(TWIN), 1) as bench:
        load.clock = bench.clock
        measured = measure_loads(bench.sensor, bench.clock, load, PUSHES)
    for step in PUSHES:
        assert measured[step.name][:3] == pytest.approx(30.0 * np.array(step.direction), abs=0.6)


def test_a_load_that_stays_is_said():
    with open_sensor(read_rig(TWIN), 1) as bench:
        hand = SimulatedHand(bench.load, BELOW_M, np.random.default_rng(1))
        hand.release = lambda: None
        with pytest.raises(DeviceError, match="the load was not taken off within 120 s"):
            measure_loads(bench.sensor, bench.clock, hand, PUSHES)


def test_a_saturated_sensor_is_no_answer():
    with open_sensor(read_rig(TWIN), 1) as bench:
        hand = SimulatedHand(bench.load, BELOW_M, np.random.default_rng(1))
        heavy = hang_mass(150.0, 0.0)
        with pytest.raises(DeviceError, match="transducer saturation"):
            measure_loads(bench.sensor, bench.clock, hand, (heavy,))


CHECKED = {
    "date": "2026-03-14",
    "source": "REAL",
    "axes": ["x", "y", "z"],
    "mass_kg": 1.0,
    "lever_mm": 0.0,
    "force_N": 9.79,
    "deviation_percent": -0.2,
    "below_shaft_mm": 44.0,
}


@pytest.mark.parametrize(
    ("sensor", "colour", "words"),
    [
        ({}, "yellow", "never checked with a hand"),
        ({"checked": CHECKED}, "green", "checked on 2026-03-14: 1 kg read 9.79 N, -0.2 %"),
        ({"checked": CHECKED | {"source": "SIM"}}, "yellow", "rehearsed on the twin only"),
        (
            {"checked": CHECKED, "axes": ["-y", "x", "z"]},
            "yellow",
            'with axes = ["x", "y", "z"], the rig file now says ["-y", "x", "z"]',
        ),
        (
            {"checked": CHECKED | {"below_shaft_mm": 80.0}},
            "yellow",
            "80 mm below the shaft, the rig file now says 45",
        ),
    ],
)
def test_a_check_holds_for_the_mounting_that_it_names(sensor, colour, words):
    section = MountedSensorSection.model_validate({"below_shaft_mm": 45.0, **sensor})
    finding = judge_last_check(section)
    assert (finding.subject, str(finding.colour)) == (CHECK, colour)
    assert words in finding.seen

"""The next experiment on a mechanism: joints follow sines, or are released with the actuators off,
within the positions, speeds and commands that were recorded.

For a sine every joint needs a motor of its own. A controller tracks the reference. The windows of
the recording are compared, each with the commands of the most probable hypothesis as feed-forward.
Releases are proposed where the actuators were off in a recording.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.decision.decision import Decision
from rfca_rig.diagnosis.experiment_design.choice import (
    SET_UP_MIN,
    ExperimentDesign,
    list_open_hypotheses,
    list_options,
    propose,
)
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, correct_window
from rfca_rig.diagnosis.mechanisms.windows import Motions
from rfca_rig.escaping import csv_line
from rfca_rig.mechanism.inverse_dynamics import compute_feed_forward, has_torque_motors
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.rollout import CommandTrace, simulate_plant
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.recording.atomic import write_atomically

Floats = NDArray[np.float64]

REPEATS = (1, 2)  # a recording holds several windows already
SECONDS = 6.0  # of a recording
RISE_S = 1.0  # in which a sine grows from rest
STEP_S = 2e-3  # of the commands
ALL = "all joints"
RELEASES = (-0.9, -0.4, 0.4, 0.9)  # shares of half the recorded range, from its middle
# Of half the recorded range: a release that is simulated with a hypothesis may leave it by as much.
BEYOND = 0.1
TRAVELS = (0.3, 1.0)  # shares of half the range that a joint travelled
SPEEDS = (
    0.15,
    0.6,
    1.4,
)  # shares of its rms speed: stick and slip, usual motion, and the peak of a sine as fast as that


@dataclass(frozen=True)
class Excitation:
    """The proposed motion.

    `t_s` (m,) are times, `reference` (m, n) positions of the joints in rad or m, and `command` (m,
    u) the feed-forward of the actuators.
    """

    t_s: Floats
    reference: Floats
    command: Floats


@dataclass(frozen=True)
class NextMotion:
    """The proposal as the diagnosis states it, with its excitation if the mechanism moves for
    it.
    """

    proposal: dict[str, object]
    excitation: Excitation | None


def propose_motion(
    problem: PreparedMechanism, found: ModelSelectionResult, decision: Decision, enough: bool
) -> NextMotion | None:
    """What to record or to measure next; None where nothing is open or nothing would help.

    Parameters
    ----------
    problem
        The recordings.
    found, decision
        The search and its decision.
    enough
        Whether there were enough conditions for a verdict.
    """
    hypotheses = list_open_hypotheses(found, decision, enough)
    if hypotheses is None:
        return None
    mechanism = problem.simulator.mechanism
    designs = []
    if has_torque_motors(mechanism):
        designs += list(_sines(problem))
    if not all(run.driven for run in problem.experiment.runs):
        designs += list(_releases(problem))
    proposal = propose(list(list_options(hypotheses, designs, enough)))
    if proposal is None:
        return None
    if proposal["kind"] != "sine":
        return NextMotion(proposal, None)
    first = hypotheses.open[0].fitted
    joint = [*mechanism.joints, ALL].index(str(proposal["joint"]))
    sine = _sine(
        problem.usual,
        joint,
        float(str(proposal["travel_relative"])),
        float(str(proposal["frequency_Hz"])),
    )
    command = sine.feed_forward(problem.simulator.plant(first.coordinates.supposed(first.x)))
    return NextMotion(proposal, Excitation(sine.t_s, sine.position, command))


def write_excitation(path: Path, mechanism: Mechanism, excitation: Excitation) -> None:
    """Write the reference of every joint and the feed-forward of every actuator over time as
    CSV, atomically.
    """
    units = ["m" if slides else "rad" for slides in mechanism.is_slide]
    names = [
        "t_s",
        *(f"{joint}_position_{unit}" for joint, unit in zip(mechanism.joints, units, strict=True)),
    ]
    names += [f"{actuator}_command" for actuator in mechanism.actuators]
    text = StringIO()
    text.write(csv_line(names))
    rows = np.column_stack([excitation.t_s, excitation.reference, excitation.command])
    np.savetxt(text, rows, delimiter=",", fmt="%.8g")
    write_atomically(path, text.getvalue().encode("utf-8"))


def _sines(problem: PreparedMechanism) -> Iterator[ExperimentDesign]:
    """Sines of each joint alone, and of all together."""
    usual = problem.usual
    names = problem.simulator.mechanism.joints
    for joint in range(len(names) + (len(names) > 1)):
        if joint < len(names):
            moving = [joint]
        else:
            moving = list(range(len(names)))
        for travel in TRAVELS:
            for speed in SPEEDS:
                # Of all joints together, the one that is fastest for its travel limits the
                # frequency.
                amplitudes = travel * usual.half_range[moving]
                fastest_Hz = np.min(speed * usual.speed[moving] / (2.0 * np.pi * amplitudes))
                f_Hz = float(f"{fastest_Hz:.2g}")
                if f_Hz * SECONDS < 0.5:
                    continue  # less than half a period
                who = names[joint] if joint < len(names) else ALL
                words = (
                    f"move {who} along a sine over {100.0 * travel:.0f} % of the recorded "
                    f"range at {f_Hz:g} Hz for {SECONDS:g} s"
                )
                settings = {
                    "kind": "sine",
                    "joint": who,
                    "travel_relative": travel,
                    "frequency_Hz": f_Hz,
                    "seconds": SECONDS,
                }
                yield _design_sine(problem, settings, words, _sine(usual, joint, travel, f_Hz))


def _releases(problem: PreparedMechanism) -> Iterator[ExperimentDesign]:
    """Releases at rest of each joint from both sides of its recorded range, the others in the
    middle of theirs.
    """
    usual = problem.usual
    for joint, name in enumerate(problem.simulator.mechanism.joints):
        unit = "m" if problem.simulator.mechanism.is_slide[joint] else "rad"
        for share in RELEASES:
            start = usual.middle.copy()
            start[joint] += share * usual.half_range[joint]
            at = float(f"{start[joint]:.2g}")
            start[joint] = at
            words = (
                f"release {name} at rest from {at:g} {unit} with the actuators off and record "
                f"{SECONDS:g} s"
            )
            settings = {"kind": "release", "joint": name, "start": at, "seconds": SECONDS}
            yield _design_release(problem, settings, words, start)


@dataclass(frozen=True)
class _Reference:
    """Reference motion of the joints: times (m,), and positions, speeds and accelerations (m,
    n).
    """

    t_s: Floats
    position: Floats
    speed: Floats
    acceleration: Floats

    def feed_forward(self, plant: Plant) -> Floats:
        """Commands (m, u) that a plant needs for this motion."""
        return compute_feed_forward(plant, self.position, self.speed, self.acceleration)


def _sine(usual: UsualMotion, joint: int, travel: float, frequency_Hz: float) -> _Reference:
    """A sine of one joint about the middle of its recorded range; for a number past the last
    joint, of all joints.
    """
    joints = len(usual.lowest)
    t_s = np.arange(0.0, SECONDS + STEP_S / 2.0, STEP_S)
    # The amplitude grows smoothly from rest, so that the start needs no jump of the command.
    grown = np.sin(0.5 * np.pi * np.minimum(t_s / RISE_S, 1.0)) ** 2
    if joint == joints:
        moving = np.ones(joints, dtype=bool)
        # Joints that move together differ in phase, so that their torques differ.
        phase = np.arange(joints) * np.pi / 3.0
    else:
        moving = np.arange(joints) == joint
        phase = np.zeros(joints)
    wave = np.sin(2.0 * np.pi * frequency_Hz * t_s[:, None] + phase) * grown[:, None]
    position = usual.middle + travel * usual.half_range * moving * wave
    speed = np.gradient(position, STEP_S, axis=0)
    return _Reference(t_s, position, speed, np.gradient(speed, STEP_S, axis=0))


def _design_release(
    problem: PreparedMechanism, settings: dict[str, object], words: str, start: Floats
) -> ExperimentDesign:
    """Design of one release; it returns None under a hypothesis by which a joint leaves the range
    that was recorded.
    """
    simulator = problem.simulator
    like = problem.conditions[0]
    window = like.windows[0].window
    usual = problem.usual
    steps = round(float(window.t_s[-1]) / STEP_S)
    t_s = STEP_S * np.arange(1.0, round(SECONDS / STEP_S) + 1.0)
    command = np.zeros((2, len(simulator.mechanism.actuators)))
    trace = CommandTrace(np.array([0.0, SECONDS]), command, is_powered=False)
    nominal = simulator.plant(MechanismInput())
    margin = BEYOND * usual.half_range

    def simulate(at: MechanismInput) -> Motions | None:
        plant = simulator.plant(at)
        motion = simulate_plant(plant, trace, start, np.zeros(len(start)), t_s)
        within = (motion.position > usual.lowest - margin) & (
            motion.position < usual.highest + margin
        )
        if not within.all():
            return None
        windows = []
        for begin in range(0, len(t_s) - steps, steps):
            begin_s = float(t_s[begin])
            planned = replace(
                window,
                start_s=begin_s,
                since_s=begin_s,
                trace=replace(trace, t_s=trace.t_s - begin_s),
                position=motion.position[begin],
                speed=motion.speed[begin],
            )
            # The simulated signal takes the place of a measurement.
            planned = replace(planned, measured=simulator.follow(plant, planned))
            windows.append(correct_window(planned, simulator, nominal, problem.torque))
        return Motions(words, "next", words, like.signals, tuple(windows))

    return ExperimentDesign(settings, words, SET_UP_MIN, 2.0 * SECONDS / 60.0, REPEATS, simulate)


def _design_sine(
    problem: PreparedMechanism, settings: dict[str, object], words: str, sine: _Reference
) -> ExperimentDesign:
    """Design of one recording; it returns None under a hypothesis that needs larger commands
    than were recorded.
    """
    simulator = problem.simulator
    like = problem.conditions[0]
    window = like.windows[0].window
    model = simulator.mechanism.model
    steps = round(float(window.t_s[-1]) / STEP_S)
    # Only the stationary part is compared, in windows of the recorded length.
    starts = range(round(RISE_S / STEP_S), len(sine.t_s) - steps, steps)
    largest = np.where(
        model.actuator_ctrllimited.astype(bool),
        np.abs(model.actuator_ctrlrange).min(axis=1),
        problem.usual.command,
    )
    nominal = simulator.plant(MechanismInput())

    def simulate(at: MechanismInput) -> Motions | None:
        plant = simulator.plant(at)
        windows = []
        command = sine.feed_forward(plant)
        if (np.abs(command).max(axis=0) > largest).any():
            return None
        for start in starts:
            start_s = float(sine.t_s[start])
            planned = replace(
                window,
                start_s=start_s,
                since_s=start_s,
                trace=CommandTrace(sine.t_s - start_s, command),
                position=sine.position[start],
                speed=sine.speed[start],
            )
            # The simulated signal takes the place of a measurement.
            planned = replace(planned, measured=simulator.follow(plant, planned))
            windows.append(correct_window(planned, simulator, nominal, problem.torque))
        return Motions(words, "next", words, like.signals, tuple(windows))

    return ExperimentDesign(settings, words, SET_UP_MIN, 2.0 * SECONDS / 60.0, REPEATS, simulate)

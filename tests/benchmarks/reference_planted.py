"""How often a change since a reference is found in real recordings, where a law was planted.

Run: python -m tests.benchmarks.reference_planted FOLDER [--pairs 77] [--seed 1] [--alone]

The recordings are public sets of driven mechanisms, in the folder that RFCA_RIG_DATASETS names.
Some recordings of a mechanism are the reference. Others are new, with altered commands: where the
motor of a joint had to overcome a further torque, for example of a spring, that torque is added to
the recorded command. With a law that the model lacks, the recorded motion is then exactly as well
explained as before. So what has changed is known exactly, and the errors of the model are those of
a real mechanism.

Kinds: a spring, dry and viscous friction, an inertia, a torque that is smaller or larger than
commanded, a late torque, or nothing. Sizes are shares of the rms torque of the joint, drawn evenly
on a log scale. Most of these recordings do not allow a detection limit, because the model errs by
more than usual.

With --alone each pair is diagnosed without its reference, too. Answers stay in FOLDER; the same
command goes on.
"""

import argparse
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.public_data.sources import RECORDINGS_VARIABLE
from tests.benchmarks.changes import STDS_OF_90, MarkedPair, print_kinds
from tests.benchmarks.reference import plain_answer
from tests.benchmarks.servo import describe_answer
from tests.public_recordings import write_public_set

NOTHING = "nothing"
SPRING = "spring"
DRY = "dry friction"
VISCOUS = "viscous friction"
INERTIA = "inertia"
SCALE = "torque scale"
LATE = "late torque"
KINDS = (NOTHING, SPRING, DRY, VISCOUS, SCALE, LATE, INERTIA)
# For each kind the effects that have its law in one joint, or in all. A late torque of a smooth
# motion is a damping and an inertia to first order; only its own effects count as right.
RIGHT = {
    NOTHING: frozenset(),
    SPRING: frozenset(("joint_spring", "joint_spring_of_one")),
    DRY: frozenset(
        ("joint_friction", "joint_friction_of_one", "joint_stribeck", "joint_hysteresis")
    ),
    VISCOUS: frozenset(("joint_damping", "joint_damping_of_one")),
    INERTIA: frozenset(("joint_inertia", "joint_inertia_of_one")),
    SCALE: frozenset(("torque_scale", "torque_scale_of_one")),
    LATE: frozenset(("torque_delay", "torque_lag")),
}
# The end of the name of each size, and its value where nothing was planted.
SIZE_OF = {
    SPRING: ("stiffness", 0.0),
    DRY: ("torque", 0.0),
    VISCOUS: ("coefficient", 0.0),
    INERTIA: ("inertia", 0.0),
    SCALE: ("factor", 1.0),
    LATE: ("delay_s", 0.0),
}
LEAST_SHARE = 0.03
MOST_SHARE = 0.5
LEAST_DELAY_S = 0.003
MOST_DELAY_S = 0.03
# Dry friction turns its sign within this speed, so that noise at rest makes no torque.
TURNING_SHARE = 0.02
# Span of the polynomial that smooths recorded speeds.
SMOOTHED_S = 0.06
DIFFERENTIATED = 3  # order of that polynomial


@dataclass(frozen=True)
class Part:
    """Recordings of a public set, by their numbers; of a single one the share between two ends."""

    name: str
    numbers: tuple[int, ...]
    begin: float = 0.0
    end: float = 1.0


@dataclass(frozen=True)
class Source:
    """A reference and new recordings of one mechanism.

    Parameters
    ----------
    reference, new
        What is compared.
    is_other
        Whether the motions differ.
    """

    reference: Part
    new: Part
    is_other: bool = True


# Recordings of less than 5 s are left out: they have too few stretches for a verdict.
SOURCES = (
    Source(Part("double", (0,)), Part("double", (1,)), is_other=False),
    Source(Part("double", (1,)), Part("double", (0,)), is_other=False),
    Source(Part("acrobot", (0, 1, 2, 3, 4)), Part("acrobot", (5, 6, 7, 8, 9))),
    Source(Part("acrobot", (5, 6, 7, 8, 9)), Part("acrobot", (0, 1, 2, 3, 4))),
    Source(Part("flexible-link", (0,), 0.0, 0.5), Part("flexible-link", (0,), 0.5, 1.0)),
    Source(Part("simple", (0, 1)), Part("controllers", (0, 1, 2))),
    Source(Part("controllers", (0, 1, 2)), Part("simple", (0, 1))),
    Source(Part("heavier", (0,), 0.0, 0.3), Part("heavier", (0,), 0.3, 1.0)),
    Source(Part("sines-one", (0, 2, 3)), Part("sines-one", (1, 4))),
    Source(Part("sines-both", (0, 1, 2)), Part("sines-one", (0, 2, 4))),
    Source(Part("sines-one", (0, 2, 3, 4)), Part("sines-both", (0, 1, 2))),
)


@dataclass(frozen=True)
class Pair:
    """What is planted where: the law in an actuated joint, and its size in SI units and as a
    share of the joint's rms torque, NaN for a delay.
    """

    source: Source
    kind: str
    joint: str
    size: float
    share: float


def read_set(name, folder):
    """The recordings of a public set, as they are; it is written into a folder first."""
    path = folder / "sets" / name
    if not path.is_dir():
        write_public_set(name, path)
    return read_experiment(path)


def draw(seed, number, experiment):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    source = SOURCES[number % len(SOURCES)]
    kind = KINDS[(number // len(SOURCES)) % len(KINDS)]
    actuated = list_actuated(experiment)
    joints = [joint for joint in actuated if rms_command(experiment, actuated[joint]) > 0.0]
    joint = str(random.choice(joints))
    share = float(np.exp(random.uniform(np.log(LEAST_SHARE), np.log(MOST_SHARE))))
    sign = float(random.choice([-1.0, 1.0]))
    if kind == NOTHING:
        return Pair(source, kind, joint, 0.0, 0.0)
    if kind == SCALE:
        return Pair(source, kind, joint, 1.0 + sign * share, share)
    if kind == LATE:
        delay_s = np.exp(random.uniform(np.log(LEAST_DELAY_S), np.log(MOST_DELAY_S)))
        return Pair(source, kind, joint, float(delay_s), float("nan"))
    torque = rms_command(experiment, actuated[joint])
    unit = np.concatenate([plant_torque(kind, run, experiment, joint) for run in experiment.runs])
    size = share * torque / float(np.sqrt(np.mean(unit**2)))
    return Pair(source, kind, joint, size, share)


def list_actuated(experiment):
    """The number of the command of each joint that has an actuator."""
    model = experiment.load_model().model
    numbers = {}
    for number, name in enumerate(experiment.actuators):
        joint = model.joint(int(model.actuator(name).trnid[0])).name
        numbers[joint] = number
    return numbers


def rms_command(experiment, number):
    """Rms of a command over all recordings."""
    values = np.concatenate([run.commands[:, number] for run in experiment.runs])
    return float(np.sqrt(np.mean(values**2)))


def plant_torque(kind, run, experiment, joint):
    """The torque (m,) that a motor needs more for a law of size 1, in recorded states."""
    numbers = [
        number
        for number, signal in enumerate(experiment.signals)
        if signal.name == joint and signal.quantity == "position"
    ]
    position = run.signals[:, numbers[0]]
    speed, acceleration = differentiate(run.t_s, position)
    if kind == SPRING:
        return position
    if kind == VISCOUS:
        return speed
    if kind == INERTIA:
        return acceleration
    turning = TURNING_SHARE * float(np.sqrt(np.mean(speed**2)))
    return np.tanh(speed / turning)


def differentiate(t_s, position):
    """Speed and acceleration (m,) of a recorded position, by local cubics."""
    even_s = float(np.median(np.diff(t_s)))
    times = np.arange(t_s[0], t_s[-1] + 0.5 * even_s, even_s)
    even = np.interp(times, t_s, position)
    span = max(DIFFERENTIATED + 2, 2 * int(0.5 * SMOOTHED_S / even_s) + 1)
    span = min(span + 1 - span % 2, len(even) - 1 + len(even) % 2)
    speed = savgol_filter(even, span, DIFFERENTIATED, deriv=1, delta=even_s)
    acceleration = savgol_filter(even, span, DIFFERENTIATED, deriv=2, delta=even_s)
    return np.interp(t_s, times, speed), np.interp(t_s, times, acceleration)


def plant(pair, run, experiment, number):
    """The recording with the command that would have led to the same motion."""
    commands = run.commands.copy()
    if pair.kind == SCALE:
        commands[:, number] /= pair.size
    elif pair.kind == LATE:
        commands[:, number] = np.interp(run.t_s + pair.size, run.t_s, commands[:, number])
    elif pair.kind != NOTHING:
        commands[:, number] += pair.size * plant_torque(pair.kind, run, experiment, pair.joint)
    return replace(run, commands=commands)


def select(part, experiment):
    """The recordings of a part."""
    runs = []
    for number in part.numbers:
        run = experiment.runs[number]
        first = round(part.begin * len(run.t_s))
        last = round(part.end * len(run.t_s))
        numbers = np.arange(len(run.t_s))
        taken = run.take((first <= numbers) & (numbers < last))
        runs.append(replace(taken, t_s=taken.t_s - taken.t_s[0]))
    return tuple(runs)


def answer(seed, number, folder, way):
    """Truth and answer of a pair, kept in a file; `way` is "with" or "alone"."""
    path = folder / f"{way}-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    source = SOURCES[number % len(SOURCES)]
    experiment = read_set(source.new.name, folder)
    pair = draw(seed, number, experiment)
    command = list_actuated(experiment)[pair.joint]
    new = select(source.new, experiment)
    planted = tuple(plant(pair, run, experiment, command) for run in new)
    problem = MechanismProblem(replace(experiment, runs=planted))
    if way == "with":
        earlier = read_set(source.reference.name, folder)
        reference = MechanismProblem(replace(earlier, runs=select(source.reference, earlier)))
        problem = ReferenceProblem(problem, reference)
    said = {
        "number": number,
        "kind": pair.kind,
        "set": source.new.name,
        "reference": source.reference.name,
        "joint": pair.joint,
        "size": pair.size,
        "share": pair.share,
        "is_other": source.is_other,
    }
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def read_size_error(said):
    """Error of the planted size as a share, and whether its 90 % interval holds it; None where
    its law was not stated in this joint.
    """
    if said["kind"] == NOTHING:
        return None
    word, neutral = SIZE_OF[said["kind"]]
    planted = said["size"] - neutral
    for effect in RIGHT[said["kind"]] & said["effects"].keys():
        for name, (value, std) in said["effects"][effect]["parameters"].items():
            # Of several joints, the size in the planted one; of a single one, its name is enough.
            if word in name and name.startswith((said["joint"], word)):
                error = value - neutral - planted
                return error / planted, abs(error) <= STDS_OF_90 * std
    return None


def mark(said):
    """The pair as tables count it."""
    error = read_size_error(said)
    size_errors = () if error is None else (error,)
    return MarkedPair(said, RIGHT[said["kind"]], is_two=False, limits=0.0, size_errors=size_errors)


def main():
    """Plants, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=len(SOURCES) * len(KINDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alone", action="store_true")
    asked = parser.parse_args()
    if not os.environ.get(RECORDINGS_VARIABLE):
        parser.error(f"{RECORDINGS_VARIABLE}: name the folder of the public recordings")
    asked.folder.mkdir(parents=True, exist_ok=True)
    ways = ("with", "alone") if asked.alone else ("with",)
    for way in ways:
        answers = [answer(asked.seed, number, asked.folder, way) for number in range(asked.pairs)]
        marked = [mark(said) for said in answers]
        print("with a reference" if way == "with" else "\nwithout a reference")
        print_kinds(marked, KINDS)
        for pair in marked:
            if pair.mark in ("effect", "slot", "wrong"):
                size = f"{pair.said['size']:.3g}"
                head = f"pair {pair.said['number']}, {pair.said['kind']} {size}: {pair.mark}"
                print(f"{head}; {describe_answer(pair.said)}")
        seconds = np.median([said["cpu_s"] for said in answers])
        print(f"median CPU seconds: {seconds:.0f}")


if __name__ == "__main__":
    main()

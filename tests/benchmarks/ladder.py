"""Whether a diagnosis says more as an effect grows: eight sizes of each of eighteen effects.

Run: python -m tests.benchmarks.ladder FOLDER [--effects NAME ...] [--seed 1]

Along a ladder everything but the size stays: the rig, the errors of its nominal values, the motion,
and the seeds of the noise. Sizes grow geometrically, from well below what the recordings could show
to well above. The grade of a right statement must never fall back from one size to the next, in the
order of GRADES; a wrong statement is reported as such, and its ladder does not count as monotone.

Arm, hopper, leg and pendulum are those of the other benchmarks, with equations of their own. Late
torques of the arm are no ladder: its simulator delays by whole samples of 2 ms, which are visible.
Every answer is compared with its own numbers too. Answers stay in FOLDER; the same command goes on.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.campaign.opening import open_experiment
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.result import Diagnosis, describe_probability
from rfca_rig.errors import RigError
from rfca_rig.exam import cases
from rfca_rig.exam.pendulums.campaign import write_pendulum_campaign
from rfca_rig.exam.pendulums.cases import PENDULUM_NOTHING, torque_scale_Nm
from rfca_rig.exam.pendulums.world import PendulumWorld
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.executors.cores import cores
from rfca_rig.executors.mapping import TaskFailure, map_unordered, process_executor
from rfca_rig.progress import ignore_share
from rfca_rig.recording.atomic import atomic_directory, write_atomically
from tests.benchmarks import mechanisms
from tests.diagnosis.invariants import list_contradictions, probability_of_set
from tests.mechanism.arm import Arm, Friction
from tests.mechanism.hopper import Hopper

LEVELS = 8
# from the least that can be said to the most
GRADES = ("nothing missing", "unexplained", "family", "mostly", "identified")
STATED = ("family", "mostly", "identified")
WRONG = "wrong"
NO_ANSWER = "refused"
# usual torques of the three joints in N m, and inertias of their rotors in kg m2, as of `draw_arm`
USUAL_TORQUE_NM = np.array([6.0, 2.5, 0.7])
ROTOR_KG_M2 = np.array([0.6, 0.15, 0.02])
# Rise of dry friction at rest as a share, and the speed at which it falls: middle of `draw_arm`.
STATIC_RISE = 0.3
FALLS_RAD_S = 0.3
# Six of ten pendulums have one link: among so many at least one has, but for one seed in 10,000.
DRAWN_PENDULUMS = 10


@dataclass(frozen=True)
class Ladder:
    """One effect in eight sizes.

    Parameters
    ----------
    right
        The ids of effects that are right.
    smallest, largest
        The ends of the ladder, in `unit`.
    write
        Writes the recordings of a size and a seed into a folder.
    diagnose
        The diagnosis of that folder.
    """

    right: tuple[str, ...]
    smallest: float
    largest: float
    unit: str
    write: Callable[[float, int, Path], None]
    diagnose: Callable[[Path], Diagnosis]

    @property
    def sizes(self) -> list[float]:
        """The eight sizes, with the three digits that are simulated."""
        sizes = np.geomspace(self.smallest, self.largest, LEVELS)
        return [float(f"{size:.3g}") for size in sizes]


@dataclass(frozen=True)
class Answer:
    """What a diagnosis says of one size; kept as JSON.

    Parameters
    ----------
    statement
        "right" or "wrong" where something is stated, else empty.
    probability
        Of the right effect in the table: that of all sets which have it.
    """

    size: float
    grade: str
    effects: tuple[str, ...] = ()
    family: str = ""
    statement: str = ""
    probability: float = 0.0
    nothing: float = 0.0
    contradictions: list[str] = field(default_factory=list)
    sentence: str = ""
    cpu_s: float = 0.0

    @property
    def rank(self) -> int | None:
        """Place of the grade in GRADES; None of a wrong statement, or where there is no answer."""
        if self.statement == WRONG or self.grade not in GRADES:
            return None
        return GRADES.index(self.grade)


def write_mechanism(draw: Callable, change: Callable, size: float, seed: int, folder: Path) -> None:
    """Two recordings of a mechanism that `draw` draws without effects, with this change.

    The numbers that `draw` takes from its generator do not depend on what is concealed.
    """
    drawn = draw(mechanisms.NOTHING, np.random.default_rng([seed, 0]))
    module, actual, nominal, seconds, noise_seed, known_to = drawn.args
    mechanisms.write(
        module,
        change(actual, size),
        nominal,
        seconds,
        noise_seed,
        known_to,
        folder,
        **drawn.keywords,
    )


def write_leg(effect_id: str, parameter: str, size: float, seed: int, folder: Path) -> None:
    """A campaign of a leg at the four conditions of the paper, from the simulator of the exam."""
    (case,) = cases.draw_cases(seed, {cases.NOTHING: 1})
    effects = {effect_id: {parameter: size}}
    write_campaign(replace(case, design=cases.PAPER_CONDITIONS, effects=effects), folder)


def write_pendulum(
    effect_id: str,
    parameter: str,
    unit_of: Callable[[PendulumWorld], float],
    size: float,
    seed: int,
    folder: Path,
) -> None:
    """Three runs of a single pendulum with an effect; `size` counts `unit_of` the true rig."""
    drawn = cases.draw_cases(seed, {PENDULUM_NOTHING: DRAWN_PENDULUMS})
    # the answer about two links takes four times as long
    case = next(case for case in drawn if case.nominal.joints == 1)
    effects = {effect_id: {parameter: size * unit_of(case.world)}}
    write_pendulum_campaign(replace(case, effects=effects), folder)


def mass_of_links_kg(world: PendulumWorld) -> float:
    """Unit of a weight at the tip."""
    return sum(world.mass_kg)


def one_second(world: PendulumWorld) -> float:
    """Unit of a delay, whatever the rig."""
    return 1.0


def diagnose_experiment(folder: Path) -> Diagnosis:
    """The answer about a mechanism."""
    return diagnose(MechanismProblem(read_experiment(folder)), ignore_share).diagnosis


def diagnose_leg(folder: Path) -> Diagnosis:
    """The answer about a leg."""
    return diagnose(LegProblem((read_campaign(folder),)), ignore_share).diagnosis


def diagnose_swings(folder: Path) -> Diagnosis:
    """The answer about a pendulum."""
    return diagnose(MechanismProblem(open_experiment(folder)), ignore_share).diagnosis


def add_dry_friction(arm: Arm, share: float) -> Arm:
    """Bristles in all joints, as a share of the usual torques."""
    friction = Friction(tuple(share * USUAL_TORQUE_NM), STATIC_RISE, FALLS_RAD_S)
    return replace(arm, friction=friction)


def add_damping(arm: Arm, share: float) -> Arm:
    """Damping in all joints, as a share of the usual torques at 1 rad/s."""
    damping = tuple(share * USUAL_TORQUE_NM)
    return replace(arm, friction=Friction((0.0, 0.0, 0.0), viscous_Nm_s_per_rad=damping))


def add_rotors(arm: Arm, share: float) -> Arm:
    """Rotors in all joints, as a share of ROTOR_KG_M2."""
    return replace(arm, rotor_kg_m2=tuple(share * ROTOR_KG_M2))


def add_gear_loss(arm: Arm, share: float) -> Arm:
    """Friction that is a share of the torque in each joint."""
    return replace(arm, friction=Friction((0.0, 0.0, 0.0), of_load=share))


def scale_torque(arm: Arm, share: float) -> Arm:
    """Torques that are larger than their commands."""
    return replace(arm, torque_factor=1.0 + share)


def add_payload(arm: Arm, share: float) -> Arm:
    """A heavier last link, as a share of its mass."""
    *others, last_kg = arm.mass_kg
    return replace(arm, mass_kg=(*others, last_kg * (1.0 + share)))


def damp_leg(hopper: Hopper, coefficient: float) -> Hopper:
    """Damping of the hopper's leg."""
    return replace(hopper, viscous_N_s_per_m=(0.0, coefficient))


def scale_plate(hopper: Hopper, share: float) -> Hopper:
    """A force plate that reads too much."""
    return replace(hopper, plate_factor=1.0 + share)


def make_arm_ladder(
    right: Sequence[str],
    smallest: float,
    largest: float,
    change: Callable,
) -> Ladder:
    """A ladder of the simulated arm; sizes are shares."""
    write = partial(write_mechanism, mechanisms.draw_arm, change)
    return Ladder(tuple(right), smallest, largest, "", write, diagnose_experiment)


def make_leg_ladder(
    right: Sequence[str],
    parameter: str,
    smallest: float,
    largest: float,
    unit: str,
) -> Ladder:
    """A ladder of the simulated leg; the first of `right` is concealed."""
    write = partial(write_leg, right[0], parameter)
    return Ladder(tuple(right), smallest, largest, unit, write, diagnose_leg)


def make_pendulum_ladder(
    right: Sequence[str],
    parameter: str,
    unit_of: Callable[[PendulumWorld], float],
    smallest: float,
    largest: float,
    unit: str = "",
) -> Ladder:
    """A ladder of the simulated pendulum; the first of `right` is concealed."""
    write = partial(write_pendulum, right[0], parameter, unit_of)
    return Ladder(tuple(right), smallest, largest, unit, write, diagnose_swings)


LADDERS = {
    # shares of the usual torques: noise and a usual model error hide 1 % and less
    "dry-friction": make_arm_ladder(
        ("joint_friction", "joint_stribeck"),
        0.001,
        0.3,
        add_dry_friction,
    ),
    "damping": make_arm_ladder(("joint_damping",), 0.0005, 0.15, add_damping),
    "rotors": make_arm_ladder(("joint_inertia",), 0.001, 0.3, add_rotors),
    "gear-loss": make_arm_ladder(("joint_load_friction",), 0.002, 0.3, add_gear_loss),
    # masses are known to 2 %
    "torque-scale": make_arm_ladder(("torque_scale",), 0.002, 0.3, scale_torque),
    "payload": make_arm_ladder(("added_mass",), 0.01, 0.8, add_payload),
    "hopper-damping": Ladder(
        right=("joint_damping_of_one", "joint_damping"),
        smallest=0.03,
        largest=15.0,
        unit="N s/m",
        write=partial(write_mechanism, mechanisms.draw_hopper, damp_leg),
        diagnose=diagnose_experiment,
    ),
    "plate-scale": Ladder(
        right=("sensor_gain",),
        smallest=0.002,
        largest=0.3,
        unit="",
        write=partial(write_mechanism, mechanisms.draw_hopper, scale_plate),
        diagnose=diagnose_experiment,
    ),
    # heights are known to 0.2 mm
    "height": make_leg_ladder(("height_offset",), "offset_mm", 0.05, 5.0, "mm"),
    "sensor-drift": make_leg_ladder(("sensor_drift",), "rate_N_per_s", 0.01, 4.0, "N/s"),
    "hinge-friction": make_leg_ladder(
        ("hinge_coulomb_friction",),
        "torque_Nm",
        0.001,
        0.3,
        "N m",
    ),
    "hinge-damping": make_leg_ladder(
        ("hinge_viscous_damping",),
        "coefficient_Nm_s_per_rad",
        0.001,
        0.4,
        "N m s/rad",
    ),
    "late-sensor": make_leg_ladder(("clock_offset", "sensor_lag"), "offset_s", 0.0001, 0.02, "s"),
    "crosstalk": make_leg_ladder(("sensor_crosstalk",), "fz_per_fy", 0.0005, 0.1, ""),
    "tip-mass": make_leg_ladder(("tip_mass",), "mass_g", 0.3, 60.0, "g"),
    "pendulum-friction": make_pendulum_ladder(
        ("joint_friction", "joint_stribeck"),
        "torque_Nm",
        torque_scale_Nm,
        0.00005,
        0.1,
    ),
    # masses are known to 2 %
    "pendulum-weight": make_pendulum_ladder(
        ("added_mass",),
        "mass_kg",
        mass_of_links_kg,
        0.002,
        0.5,
    ),
    "pendulum-late-torque": make_pendulum_ladder(
        ("torque_delay", "torque_lag"),
        "delay_s",
        one_second,
        0.0005,
        0.03,
        "s",
    ),
}


def judge_statement(diagnosis: Diagnosis, right: Sequence[str]) -> str:
    """Whether what is stated is right or wrong; empty where nothing is stated.

    A stated effect is right if it cannot be told from a right one. An effect too many is wrong.
    """
    if diagnosis.grade not in STATED:
        return ""
    if diagnosis.effects:
        for effect in diagnosis.effects:
            if not {effect.id, *effect.cannot_tell_from} & set(right):
                return WRONG
        return "right"
    if set(diagnosis.family.members) & set(right):
        return "right"
    return WRONG


def answer_size(folder: Path, seed: int, step: tuple[str, int]) -> Answer:
    """The answer to one size of a ladder, from its file where it is known."""
    name, level = step
    ladder = LADDERS[name]
    size = ladder.sizes[level]
    path = folder / f"{name}-{seed}-{level}.json"
    if path.exists():
        return Answer(**json.loads(path.read_text(encoding="utf-8")))
    recordings = folder / f"{name}-{seed}-{level}"
    if not recordings.is_dir():
        with atomic_directory(recordings) as into:
            ladder.write(size, seed, into)
    start_s = time.process_time()
    try:
        diagnosis = ladder.diagnose(recordings)
        answer = describe_answer(diagnosis, ladder, size, time.process_time() - start_s)
    except RigError as error:
        answer = Answer(size, NO_ANSWER, sentence=str(error))
    write_atomically(path, json.dumps(asdict(answer), indent=1).encode())
    return answer


def describe_answer(diagnosis: Diagnosis, ladder: Ladder, size: float, cpu_s: float) -> Answer:
    """What is kept of a diagnosis."""
    probability = 0.0
    for row in diagnosis.rivals:
        if set(row.ids) & set(ladder.right):
            probability += row.probability
    return Answer(
        size=size,
        grade=diagnosis.grade,
        effects=tuple(effect.id for effect in diagnosis.effects),
        family=diagnosis.family.id if diagnosis.family is not None else "",
        statement=judge_statement(diagnosis, ladder.right),
        probability=probability,
        nothing=probability_of_set(diagnosis, ()),
        contradictions=list_contradictions(diagnosis),
        sentence=diagnosis.sentence,
        cpu_s=cpu_s,
    )


def find_fall(answers: Sequence[Answer]) -> str:
    """Where a ladder falls back or states what is wrong, in words; empty where it is monotone."""
    before = None
    for answer in answers:
        if answer.rank is None:
            if answer.statement == WRONG:
                reason = "wrong statement"
            else:
                reason = answer.grade
            return f"{reason} at {answer.size:g}"
        if before is not None and answer.rank < before.rank:
            fall = f"{before.grade} at {before.size:g} to {answer.grade} at {answer.size:g}"
            return f"falls from {fall}"
        before = answer
    return ""


def print_ladder(name: str, answers: Sequence[Answer]) -> None:
    """The eight grades of an effect, its probability in the table, and contradictions."""
    ladder = LADDERS[name]
    print(f"\n{name}: {' or '.join(ladder.right)}")
    for answer in answers:
        size = f"{answer.size:g} {ladder.unit}".strip()
        stated = " with ".join(answer.effects) or answer.family
        probability = describe_probability(answer.probability)
        line = f"  {size:>12}  {answer.grade:<16} {probability:>9}  {answer.statement:<6} {stated}"
        print(line.rstrip())
        for contradiction in answer.contradictions:
            print(f"{'':16}contradiction: {contradiction}")
    fall = find_fall(answers)
    print(f"  {'not monotone: ' + fall if fall else 'monotone'}")


def main() -> None:
    """Simulates, diagnoses and prints the ladders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--effects", nargs="+", choices=tuple(LADDERS), default=tuple(LADDERS))
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    steps = [(name, level) for name in asked.effects for level in range(LEVELS)]
    work = partial(answer_size, asked.folder, asked.seed)
    answers = {}
    with process_executor(cores()) as executor:
        for step, answer in map_unordered(executor, work, steps):
            if isinstance(answer, TaskFailure):
                raise SystemExit(f"{step[0]}, size {step[1] + 1}: {answer.reason}")
            answers[step] = answer
    monotone = 0
    for name in asked.effects:
        ladder = [answers[name, level] for level in range(LEVELS)]
        print_ladder(name, ladder)
        monotone += not find_fall(ladder)
    print(f"\nmonotone in {monotone} of {len(asked.effects)}")
    contradictory = sum(bool(answer.contradictions) for answer in answers.values())
    print(f"answers that contradict themselves: {contradictory} of {len(answers)}")
    cpu_s = [answer.cpu_s for answer in answers.values()]
    print(f"CPU seconds of a diagnosis: median {np.median(cpu_s):.0f}")


if __name__ == "__main__":
    main()

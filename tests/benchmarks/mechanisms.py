"""How often the diagnosis of a mechanism is right: arms of three geared joints, and hoppers on a
rail, simulated from their own equations.

Run: python -m tests.benchmarks.mechanisms FOLDER [--mechanism arm|hopper|hopper-own-contact]
[--cases 40] [--seed 1] [--statements FILE]

Every case draws a mechanism, nominal values that are off by their standard uncertainty, and what is
concealed: nothing, or one effect. Its law is wrong by 20 to 40 %: dry friction is LuGre's or rises
at rest, and a share of it follows the load; contacts are Hunt and Crossley's; behind gears that
yield the rotors are bodies of their own. Answers stay in FOLDER; the same command goes on. FILE
gets all statements with their truth, for `rfca_rig.exam.calibrate`.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.errors import RigError
from rfca_rig.exam.calibrate import STATEMENTS
from rfca_rig.executors.cores import cores
from rfca_rig.executors.mapping import TaskFailure, map_unordered, process_executor
from rfca_rig.model.catalogue import families_of, members_of
from rfca_rig.progress import ignore_share
from rfca_rig.recording.atomic import write_atomically
from tests.mechanism import arm, hopper

NOTHING = "nothing"
DRY = ("joint_friction_of_one", "joint_friction", "joint_stribeck")
LATE = ("torque_delay", "torque_lag")
# what is concealed, and the ids that are right
ARM_KINDS = {
    NOTHING: (),
    "dry friction": ("joint_friction", "joint_stribeck"),
    "dry friction of one": DRY,
    "damping": ("joint_damping",),
    "rotors": ("joint_inertia",),
    "gear loss": ("joint_load_friction",),
    "torque scale": ("torque_scale",),
    "late torque": LATE,
    "backlash": ("gear_backlash",),
    "elastic gear": ("gear_compliance",),
}
GEARS = ("backlash", "elastic gear")
SOLES = ("softer sole", "sole that loses energy")
HOPPER_KINDS = {
    NOTHING: (),
    "dry friction of the leg": DRY,
    "damping of the leg": ("joint_damping_of_one", "joint_damping"),
    "softer sole": ("contact_stiffness",),
    "sole that loses energy": ("contact_damping",),
    "payload": ("added_mass",),
    "force scale": ("torque_scale",),
    "late force": LATE,
    "late plate": ("sensor_lag", "clock_offset"),
    "plate scale": ("sensor_gain",),
}
HOPPER_KNOWN_TO = {
    "mass_relative": 0.01,
    "zero_offset_m": 0.0002,
    "contact_stiffness_relative": 0.1,
    "contact_damping_relative": 0.5,
    "sensor_offset_N": 0.2,
    "command_delay_s": 0.001,
}


@dataclass(frozen=True)
class Case:
    """What is concealed, and a campaign with it: `write` makes it in a folder."""

    kind: str
    write: object


def draw_arm(kind, random):
    """An arm whose links are 20 % longer or shorter, and heavier or lighter, than the usual
    ones.
    """
    mass_relative = 0.02
    zero_rad = 0.002
    usual_Nm = np.array([6.0, 2.5, 0.7])
    nominal = arm.Arm(
        length_m=tuple(np.array([0.35, 0.3, 0.2]) * random.uniform(0.8, 1.2, 3)),
        mass_kg=tuple(np.array([2.0, 1.4, 0.7]) * random.uniform(0.8, 1.2, 3)),
    )
    actual = replace(
        nominal,
        mass_kg=tuple(
            np.array(nominal.mass_kg) * (1.0 + mass_relative * random.standard_normal(3))
        ),
    )
    actual = replace(actual, zero_rad=tuple(zero_rad * random.standard_normal(3)))
    size = random.uniform(0.05, 0.25, 3) * usual_Nm
    rise = random.uniform(0.2, 0.4)
    load = random.uniform(0.0, 0.03)
    one = np.arange(3) == random.integers(3)
    of_gears = random.spawn(1)[0]  # whose numbers leave those of the other kinds alone
    if kind in GEARS:  # the model file knows the rotors
        rotors = tuple(of_gears.uniform(0.5, 1.5, 3) * (0.06, 0.02, 0.004))
        nominal = replace(nominal, rotor_kg_m2=rotors)
        actual = replace(actual, rotor_kg_m2=rotors)
    yields_rad = of_gears.uniform(0.015, 0.04, 3)
    losing_s = of_gears.uniform(0.003, 0.01)
    changes = {
        "backlash": {
            "gear": arm.Gear(
                (2e4, 8e3, 2e3), tuple(of_gears.uniform(0.02, 0.05, 3)), (5.0, 2.0, 0.5)
            )
        },
        "elastic gear": {
            "gear": arm.Gear(
                tuple(usual_Nm / yields_rad),
                (0.0, 0.0, 0.0),
                tuple(losing_s * usual_Nm / yields_rad),
            )
        },
        "dry friction": {"friction": arm.Friction(tuple(size), rise, 0.3, of_load=load)},
        "dry friction of one": {"friction": arm.Friction(tuple(size * one), rise, 0.3)},
        "damping": {
            "friction": arm.Friction((0.0, 0.0, 0.0), viscous_Nm_s_per_rad=tuple(0.5 * size))
        },
        "rotors": {"rotor_kg_m2": tuple(random.uniform(0.05, 0.2, 3) * (0.6, 0.15, 0.02))},
        "gear loss": {
            "friction": arm.Friction(tuple(0.1 * size), of_load=random.uniform(0.05, 0.25))
        },
        "torque scale": {
            "torque_factor": 1.0 + random.choice([-1.0, 1.0]) * random.uniform(0.08, 0.2)
        },
        "late torque": {"torque_delay_s": 0.002 * int(random.integers(3, 9))},
    }
    known_to = {
        "mass_relative": mass_relative,
        "centre_of_mass_m": 0.002,
        "zero_offset_rad": zero_rad,
    }
    return partial(
        write,
        arm,
        replace(actual, **changes.get(kind, {})),
        nominal,
        8.0,
        int(random.integers(2**31)),
        known_to,
    )


def draw_hopper(kind, random, own_contact=False):
    """A hopper whose masses, sole and zeros are off by their standard uncertainties.

    With `own_contact` the experiment states Hunt and Crossley's sole, and a concealed sole has
    other exponents.
    """
    nominal = hopper.Hopper()
    actual = misjudge_hopper(nominal, random)
    share = random.uniform(0.08, 0.2)
    sign = random.choice([-1.0, 1.0])
    changes = {
        "dry friction of the leg": {
            "dry_N": (0.0, random.uniform(1.5, 4.5)),
            "rise": random.uniform(0.2, 0.4),
        },
        "damping of the leg": {"viscous_N_s_per_m": (0.0, random.uniform(3.0, 9.0))},
        "softer sole": {
            "stiffness_N_per_m1p5": actual.stiffness_N_per_m1p5 * random.uniform(0.15, 0.5)
        },
        "sole that loses energy": {
            "damping_s_per_m": nominal.damping_s_per_m * random.uniform(3.0, 8.0)
        },
        "payload": {"trunk_kg": actual.trunk_kg * (1.0 + share)},
        "force scale": {"force_factor": 1.0 + sign * share},
        "late force": {"force_delay_s": 0.002 * int(random.integers(3, 9))},
        "late plate": {"plate_lag_s": random.uniform(0.006, 0.015)},
        "plate scale": {"plate_factor": 1.0 + sign * share},
    }
    actual = replace(actual, **changes.get(kind, {}))
    seed = int(random.integers(2**31))
    of_sole = random.spawn(1)[0]
    if own_contact and kind in SOLES:
        actual = replace(actual, other_powers=draw_powers(of_sole))
    return partial(
        write, hopper, actual, nominal, 5.2, seed, HOPPER_KNOWN_TO, own_contact=own_contact
    )


def misjudge_hopper(nominal, random):
    """The hopper whose masses, sole and zeros the nominal one states within HOPPER_KNOWN_TO."""
    trunk, foot, stiffness, damping = 1.0 + random.standard_normal(4) * (0.01, 0.01, 0.1, 0.5)
    return replace(
        nominal,
        trunk_kg=trunk * nominal.trunk_kg,
        foot_kg=foot * nominal.foot_kg,
        stiffness_N_per_m1p5=stiffness * nominal.stiffness_N_per_m1p5,
        damping_s_per_m=max(0.1, damping) * nominal.damping_s_per_m,
        zero_m=draw_zeros(random),
    )


def draw_zeros(random):
    """What the encoders of a hopper read too much, in m."""
    return tuple(HOPPER_KNOWN_TO["zero_offset_m"] * random.standard_normal(2))


def draw_powers(random):
    """How far the exponents of a sole are from Hunt and Crossley's."""
    return tuple(random.uniform(0.15, 0.3, 2) * random.choice([-1.0, 1.0], 2))


def write(module, actual, nominal, seconds, seed, known_to, folder, **how):
    """Two recordings of the actual mechanism, described by the nominal one."""
    module.write_campaign(
        folder,
        nominal,
        [module.record(actual, seconds, seed + k) for k in range(2)],
        known_to,
        **how,
    )


@dataclass(frozen=True)
class Mechanism:
    """The kinds of cases of a mechanism with the ids that are right, and how a case is drawn."""

    kinds: Mapping[str, tuple[str, ...]]
    draw: object


MECHANISMS = {
    "arm": Mechanism(ARM_KINDS, draw_arm),
    "hopper": Mechanism(HOPPER_KINDS, draw_hopper),
    "hopper-own-contact": Mechanism(HOPPER_KINDS, partial(draw_hopper, own_contact=True)),
}


def draw(mechanism, seed, number):
    """Case `number` of a seed, whatever the others are. Every third one conceals nothing."""
    random = np.random.default_rng([seed, number])
    kinds = list(mechanism.kinds)
    if number % 3 == 0:
        kind = NOTHING
    else:
        kind = kinds[1 + (number - number // 3 - 1) % (len(kinds) - 1)]
    return Case(kind, mechanism.draw(kind, random))


def answer(name, seed, folder, number):
    """Kind, grade, stated effects with their probabilities, family and seconds of a case, kept
    in a file.
    """
    path = folder / f"{name}-{number:04d}.json"
    campaign = folder / f"{name}-{number:04d}"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    case = draw(MECHANISMS[name], seed, number)
    if not campaign.is_dir():
        case.write(campaign)
    begun_s = time.process_time()
    try:
        problem = MechanismProblem(read_experiment(campaign))
        found = diagnose(problem, ignore_share).diagnosis
        said = {
            "kind": case.kind,
            "grade": found.grade,
            "effects": {effect.id: effect.probability for effect in found.effects},
            "family": found.family.id if found.family is not None else "",
            "closest": list(found.rivals[0].ids),
            "support": found.support,
            "cpu_s": time.process_time() - begun_s,
        }
    except RigError as error:
        said = {
            "kind": case.kind,
            "grade": "refused",
            "effects": {},
            "family": "",
            "closest": [str(error)],
            "support": [],
            "cpu_s": 0.0,
        }
    path.write_text(json.dumps(said), encoding="utf-8")
    return said


def mark(said, kinds):
    """right, family, wrong, silent; a statement without its cause, beside a right one, is wrong
    too.
    """
    right = set(kinds[said["kind"]])
    families = {family.id for effect in right for family in families_of(effect)}
    if said["effects"]:
        if set(said["effects"]) <= right:
            return "right"
        if all({f.id for f in families_of(name)} & families for name in said["effects"]):
            return "family"
        return "wrong"
    if said["grade"] == "family":
        if said["family"] in families:
            return "family"
        return "wrong"
    if said["kind"] == NOTHING and said["grade"] == "nothing missing":
        return "right"
    return "silent"


def label_statements(name, seed, answers):
    """The statements of all answers as a source of `rfca_rig.exam.calibrate`; `answers` are in
    order of their numbers.
    """
    statements = []
    for number, said in enumerate(answers):
        right = set(MECHANISMS[name].kinds[said["kind"]])
        for one in said["support"]:
            if one["kind"] == "effect":
                of_statement = {one["id"], *one["cannot_tell_from"]}
            else:
                of_statement = members_of(one["id"])
            statement = {
                "case": f"{name}-{number:04d}",
                "rig": name,
                "kind": one["kind"],
                "values": one["values"],
            }
            statements.append({**statement, "true": bool(right & of_statement)})
    return {
        "format": STATEMENTS,
        "words": f"{name}, seed {seed}, {len(answers)} cases",
        "statements": statements,
    }


def main():
    """Draws, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mechanism", choices=tuple(MECHANISMS), default="arm")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--statements", type=Path)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    answers = {}
    work = partial(answer, asked.mechanism, asked.seed, asked.folder)
    with process_executor(cores()) as executor:
        for number, said in map_unordered(executor, work, range(asked.cases)):
            if isinstance(said, TaskFailure):
                raise SystemExit(f"case {number}: {said.reason}")
            answers[number] = said
    found = [answers[number] for number in range(asked.cases)]
    if asked.statements is not None:
        content = label_statements(asked.mechanism, asked.seed, found)
        write_atomically(asked.statements, (json.dumps(content, indent=1) + "\n").encode())
    kinds = MECHANISMS[asked.mechanism].kinds
    words = ("right", "family", "wrong", "silent")
    counts = Counter((said["kind"], mark(said, kinds)) for said in found)
    print(f"{'concealed':<26}" + "".join(f"{word:>8}" for word in words))
    for kind in kinds:
        print(f"{kind:<26}" + "".join(f"{counts[kind, word]:>8}" for word in words))
    for number, said in enumerate(found):
        if mark(said, kinds) in ("wrong", "silent"):
            print(
                f"case {number}, {said['kind']}: {said['grade']}, "
                f"{said['effects'] or said['family']}, closest {said['closest']}"
            )
    print(
        "CPU seconds of a diagnosis: median "
        f"{np.median([said.get('cpu_s', 0.0) for said in found]):.0f}"
    )


if __name__ == "__main__":
    main()

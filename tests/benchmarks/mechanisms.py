"""How often the diagnosis of a mechanism is right: arms of three geared joints, simulated by SciPy from their own equations.

Run: python -m tests.benchmarks.mechanisms FOLDER [--cases 40] [--seed 1]

Every case draws an arm, nominal values that are off by their standard uncertainty, and what is concealed: nothing, or one effect. Its law
is wrong by 20 to 40 %, as friction is LuGre's with a Stribeck rise and a share of the load. Answers stay in FOLDER; the same command goes
on.
"""

import argparse
import json
from collections import Counter
from dataclasses import dataclass, replace
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.crew.cores import cores
from rfca_rig.diagnosis.mechanisms.diagnose import diagnose_mechanism
from rfca_rig.errors import RigError
from rfca_rig.model.families import families_of
from tests.mechanism.arm import Arm, Friction, record, write_campaign

SECONDS, RUNS = 8.0, 2
MASS_RELATIVE, ZERO_RAD = 0.02, 0.002
NOTHING = "nothing"
# what is concealed, and the ids that are right
KINDS = {
    NOTHING: (),
    "dry friction": ("joint_friction", "joint_stribeck"),
    "dry friction of one": ("joint_friction_of_one", "joint_friction", "joint_stribeck"),
    "damping": ("joint_damping",),
    "rotors": ("joint_inertia",),
    "gear loss": ("joint_load_friction",),
    "torque scale": ("torque_scale",),
    "late torque": ("torque_delay", "torque_lag"),
}
TORQUE_NM = np.array([6.0, 2.5, 0.7])  # usual in these arms


@dataclass(frozen=True)
class Case:
    """What is concealed in which arm, what the model file says of it, and the seed of the recordings."""

    number: int
    kind: str
    arm: Arm
    nominal: Arm
    seed: int


def draw(seed, number):
    """Case `number` of a seed, whatever the others are. Every third one conceals nothing."""
    random = np.random.default_rng([seed, number])
    kinds = list(KINDS)
    kind = NOTHING if number % 3 == 0 else kinds[1 + (number - number // 3 - 1) % (len(kinds) - 1)]
    nominal = Arm(
        length_m=tuple(np.array([0.35, 0.3, 0.2]) * random.uniform(0.8, 1.2, 3)),
        mass_kg=tuple(np.array([2.0, 1.4, 0.7]) * random.uniform(0.8, 1.2, 3)),
    )
    arm = replace(nominal, mass_kg=tuple(np.array(nominal.mass_kg) * (1.0 + MASS_RELATIVE * random.standard_normal(3))))
    arm = replace(arm, zero_rad=tuple(ZERO_RAD * random.standard_normal(3)))
    size = random.uniform(0.05, 0.25, 3) * TORQUE_NM
    rise, load = random.uniform(0.2, 0.4), random.uniform(0.0, 0.03)
    one = np.arange(3) == random.integers(3)
    changes = {
        "dry friction": {"friction": Friction(tuple(size), rise, 0.3, of_load=load)},
        "dry friction of one": {"friction": Friction(tuple(size * one), rise, 0.3)},
        "damping": {"friction": Friction((0.0, 0.0, 0.0), viscous_Nm_s_per_rad=tuple(0.5 * size))},
        "rotors": {"rotor_kg_m2": tuple(random.uniform(0.05, 0.2, 3) * (0.6, 0.15, 0.02))},
        "gear loss": {"friction": Friction(tuple(0.1 * size), of_load=random.uniform(0.05, 0.25))},
        "torque scale": {"torque_factor": 1.0 + random.choice([-1.0, 1.0]) * random.uniform(0.08, 0.2)},
        "late torque": {"torque_delay_s": 0.002 * int(random.integers(3, 9))},
    }
    return Case(number, kind, replace(arm, **changes.get(kind, {})), nominal, int(random.integers(2**31)))


def answer(folder, case):
    """Grade, stated effects with their probabilities, and family, kept in a file."""
    path = folder / f"case-{case.number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    campaign = folder / f"case-{case.number:04d}"
    if not campaign.is_dir():
        recordings = [record(case.arm, SECONDS, case.seed + k) for k in range(RUNS)]
        known_to = {"mass_relative": MASS_RELATIVE, "centre_of_mass_m": 0.002, "zero_offset_rad": ZERO_RAD}
        write_campaign(campaign, case.arm, case.nominal, recordings, known_to)
    try:
        found = diagnose_mechanism(read_experiment(campaign), lambda *_: None).diagnosis
        said = {
            "kind": case.kind,
            "grade": found.grade,
            "effects": {effect.id: effect.probability for effect in found.effects},
            "family": found.family.id if found.family is not None else "",
            "closest": list(found.rivals[0].ids),
        }
    except RigError as error:
        said = {"kind": case.kind, "grade": "refused", "effects": {}, "family": "", "closest": [str(error)]}
    path.write_text(json.dumps(said), encoding="utf-8")
    return said


def mark(said):
    """right, family, wrong, silent; a statement without its cause, beside a right one, is wrong too."""
    right = set(KINDS[said["kind"]])
    families = {family.id for effect in right for family in families_of(effect)}
    if said["effects"]:
        if set(said["effects"]) <= right:
            return "right"
        return "family" if all({f.id for f in families_of(name)} & families for name in said["effects"]) else "wrong"
    if said["grade"] == "family":
        return "family" if said["family"] in families else "wrong"
    return "right" if said["kind"] == NOTHING and said["grade"] == "nothing missing" else "silent"


def main():
    """Draws, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    with Pool(cores()) as pool:
        found = pool.starmap(answer, [(asked.folder, draw(asked.seed, number)) for number in range(asked.cases)], chunksize=1)
    counts = Counter((said["kind"], mark(said)) for said in found)
    marks = ("right", "family", "wrong", "silent")
    print(f"{'concealed':<22}" + "".join(f"{word:>8}" for word in marks))
    for kind in KINDS:
        print(f"{kind:<22}" + "".join(f"{counts[kind, word]:>8}" for word in marks))
    for number, said in enumerate(found):
        if mark(said) in ("wrong", "silent"):
            print(f"case {number}, {said['kind']}: {said['grade']}, {said['effects'] or said['family']}, closest {said['closest']}")


if __name__ == "__main__":
    main()

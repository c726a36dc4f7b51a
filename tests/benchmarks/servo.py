"""How often the diagnosis sees a heavier weight or another arm on a position servo.

Run: python -m tests.benchmarks.servo FOLDER [--pairs 40] [--seed 1] [--own-law]

Each pair draws a servo with its weight and arm, and does what a user would do:

1. record a reference folder, and fit the nominal model of the data sheet to it, with dry friction
2. record a second folder, in which the weight, the arm or nothing has changed
3. diagnose the second folder with the fitted model as its nominal model

The servo's laws differ from the catalogue's (`tests/mechanism/servo.py`). The fit takes only laws
that MJCF holds: a model file cannot pass on friction that grows with load or falls with speed, so
these remain missing in both folders.

The size of a change is the change of the weight's torque at horizontal, as a share of the nominal
one. The detection limit is the median, over the unchanged pairs that exclude an added mass, of the
smallest mass that the diagnosis says it would have seen, as a share of the nominal mass: both
shares are equal for a mass that is added where the mass is already.

With --own-law the model lacks dry friction and a part c w^n, and each folder is diagnosed twice:
with the catalogue alone, and with the lab's own law c w^n beside it. An experiment.toml names no
own laws, so the law is put into the list of effects.

Answers stay in FOLDER; the same command goes on.
"""

import argparse
import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from unittest.mock import patch

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms import prepared
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import FitOptions
from rfca_rig.errors import RigError
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.plant import JointLaw
from rfca_rig.model import catalogue as catalogue_module
from rfca_rig.model.catalogue import list_related, members_of
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.progress import ignore_share
from tests.mechanism import servo as servos
from tests.mechanism.servo import GRAVITY_M_S2, TRAJECTORIES, GearFriction, Motor, Servo

NOTHING = "nothing"
WEIGHT = "weight"
ARM = "arm"
# Of ten pairs three are unchanged, which makes 12 of 40.
UNCHANGED = (0, 3, 6)
# What is right where weight or arm have changed, alone or as a member of a family.
BODY_EFFECTS = frozenset(("added_mass", "centre_of_mass"))
# Laws that the servo has and its fitted model has not.
LAWS_OF_SERVO = frozenset(("joint_stribeck", "joint_hysteresis", "joint_load_friction"))
# Right beside a body's effect: a heavier weight adds friction, since a share follows the load.
RIGHT_BESIDE_BODY = LAWS_OF_SERVO | {"joint_friction"}
# Dry friction is the friction law that MJCF holds; viscous friction is in [known_to].
FITTED_EFFECTS = ("joint_friction",)
SECONDS = {"lift and lower": 8.0, "sines": 8.0, "steps": 8.0, "release": 6.0}
# The supply differs by a percent or two from recording to recording.
SUPPLY_STD = 0.012
LARGEST_SUPPLY_ERROR = 0.025
# Known before the fit: mass from a scale, lever from a ruler, motor from its data sheet.
MASS_STD_RELATIVE = 0.01
CENTRE_STD_M = 0.001
ZERO_STD_RAD = 0.005
STALL_STD_RELATIVE = 0.08
BACK_EMF_STD_RELATIVE = 0.1
ROTOR_STD_RELATIVE = 0.2
# The tutorial's value for torques from motor currents; a duty is no better.
TORQUE_ERROR_RELATIVE = 0.03
# After the fit a value is not better known than it repeats: supply voltage, warm grease, assembly.
LEAST_GAIN_STD = 0.015
LEAST_FRICTION_STD_RELATIVE = 0.1
LEAST_DAMPING_STD_RELATIVE = 0.05
LEAST_ZERO_STD_RAD = 0.001
# Two-sided 90 % of a normal distribution.
STDS_OF_90 = 1.645
# Used where no unchanged pair excludes an added mass: three times the stated torque error.
ASSUMED_LIMIT = 3.0 * TORQUE_ERROR_RELATIVE
# Lower ends of the rows of the table, in detection limits.
SIZES_IN_LIMITS = (0.0, 1.0, 2.0, 4.0, 8.0)
MARKS = ("right", "family", "wrong", "silent")
RIVALS_KEPT = 12
OWN_LAW = "power_friction"
OWN_LAW_FAMILY = "joint_loss_with_speed"
OWN_LAW_KNOTS = 61
# Faster than any servo of the draw turns.
OWN_LAW_FASTEST_RAD_S = 12.0
OWN_LAW_RIGHT = RIGHT_BESIDE_BODY | {"joint_damping", "joint_drag", OWN_LAW}


@dataclass(frozen=True)
class Pair:
    """What one pair records.

    Parameters
    ----------
    kind
        What has changed before the second folder.
    nominal
        The servo as the user's data sheet, scale and ruler have it.
    reference, changed
        The servo in the first and in the second folder.
    conditions
        Motions of each folder.
    """

    kind: str
    nominal: Servo
    reference: Servo
    changed: Servo
    conditions: tuple[str, ...]


def draw_servo(random):
    """A servo whose weight takes 8 to 25 % of its stall torque at horizontal."""
    stall_Nm = random.uniform(3.0, 9.0)
    no_load_rad_s = random.uniform(4.5, 8.0)
    ratio = random.uniform(150.0, 300.0)
    supply_V = 12.0
    constant = supply_V / (ratio * no_load_rad_s)
    motor = Motor(
        ratio=ratio,
        torque_constant_Nm_per_A=constant,
        resistance_ohm=ratio * constant * supply_V / stall_Nm,
        supply_V=supply_V,
        rotor_kg_m2=random.uniform(0.004, 0.015) / ratio**2,
    )
    driving_share = random.uniform(0.05, 0.3)
    friction = GearFriction(
        dry_Nm=random.uniform(0.015, 0.05) * stall_Nm,
        rise=random.uniform(0.1, 0.4),
        falls_rad_s=random.uniform(0.1, 0.4),
        viscous_Nm_s_per_rad=random.uniform(0.02, 0.15) * motor.back_emf_Nm_s_per_rad,
        driving_share=driving_share,
        back_driving_share=driving_share * random.uniform(0.3, 1.0),
        bristle_rad=random.uniform(0.0005, 0.002),
    )
    controller = servos.Controller(
        rate_Hz=float(random.choice([100.0, 125.0, 200.0])),
        duty_per_rad=random.uniform(4.0, 8.0),
        duty_s_per_rad=random.uniform(0.03, 0.1),
        speed_filter_s=random.uniform(0.01, 0.025),
    )
    arm_m = random.uniform(0.1, 0.2)
    rod_kg = random.uniform(0.03, 0.08)
    gravity_Nm = random.uniform(0.08, 0.25) * stall_Nm
    weight_kg = gravity_Nm / (GRAVITY_M_S2 * arm_m) - 0.5 * rod_kg
    zero_rad = ZERO_STD_RAD * random.standard_normal()
    return Servo(weight_kg, arm_m, rod_kg, motor, friction, controller, zero_rad)


def misjudge(servo, random):
    """The servo without friction, with the values that a user would write down for it."""
    stall, back_emf, rotor = 1.0 + random.standard_normal(3) * (
        STALL_STD_RELATIVE,
        BACK_EMF_STD_RELATIVE,
        ROTOR_STD_RELATIVE,
    )
    mass = 1.0 + MASS_STD_RELATIVE * random.standard_normal()
    arm_m = servo.arm_m + CENTRE_STD_M * random.standard_normal()
    motor = servo.motor
    # Back-EMF goes with the square of the constant over the resistance, the stall torque linearly.
    constant = motor.torque_constant_Nm_per_A * back_emf / stall
    motor = replace(
        motor,
        torque_constant_Nm_per_A=constant,
        resistance_ohm=motor.resistance_ohm * back_emf / stall**2,
        rotor_kg_m2=motor.rotor_kg_m2 * rotor,
    )
    return Servo(
        weight_kg=servo.weight_kg * mass,
        arm_m=arm_m,
        rod_kg=servo.rod_kg * mass,
        motor=motor,
        controller=servo.controller,
    )


def choose_kind(number):
    """Three of ten pairs are unchanged; of the others every second one has another arm."""
    if number % 10 in UNCHANGED:
        return NOTHING
    changed_before = sum(k % 10 not in UNCHANGED for k in range(number))
    if changed_before % 2 == 0:
        return WEIGHT
    return ARM


def change(servo, kind, random):
    """The servo with another weight or arm; the size is drawn log-uniformly."""
    more_weight = np.exp(random.uniform(np.log(0.1), np.log(1.5)))
    other_arm = random.choice([-1.0, 1.0]) * np.exp(random.uniform(np.log(0.1), np.log(0.5)))
    if kind == WEIGHT:
        return replace(servo, weight_kg=servo.weight_kg * (1.0 + more_weight))
    if kind == ARM:
        return replace(servo, arm_m=servo.arm_m * (1.0 + other_arm))
    return servo


def draw_conditions(random):
    """Two to four motions, of which two are always those that lift and those that shake."""
    return tuple(TRAJECTORIES)[: 2 + int(random.integers(3))]


def draw(seed, number):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    reference = draw_servo(random)
    kind = choose_kind(number)
    return Pair(
        kind=kind,
        nominal=misjudge(reference, random),
        reference=reference,
        changed=change(reference, kind, random),
        conditions=draw_conditions(random),
    )


def record_all(servo, conditions, seeds):
    """A recording of each motion, with a supply voltage of its own.

    The seeds are of this folder alone, so that a run that goes on records the same.
    """
    random = np.random.default_rng(seeds)
    recordings = []
    for condition in conditions:
        off = np.clip(
            SUPPLY_STD * random.standard_normal(),
            -LARGEST_SUPPLY_ERROR,
            LARGEST_SUPPLY_ERROR,
        )
        seed = int(random.integers(2**31))
        recording = servos.record(servo, condition, SECONDS[condition], seed, 1.0 + off)
        recordings.append(recording)
    return recordings


def list_known_before(nominal):
    """[known_to] of the reference folder."""
    motor = nominal.motor
    return {
        "mass_relative": MASS_STD_RELATIVE,
        "centre_of_mass_m": CENTRE_STD_M,
        "zero_offset_rad": ZERO_STD_RAD,
        "command_gain_relative": STALL_STD_RELATIVE,
        "joint_damping_Nm_s_per_rad": BACK_EMF_STD_RELATIVE * motor.back_emf_Nm_s_per_rad,
        "rotor_inertia_kg_m2": ROTOR_STD_RELATIVE * motor.reflected_kg_m2,
        "torque_error_relative": TORQUE_ERROR_RELATIVE,
    }


def list_known_after(before, fit, mechanism):
    """[known_to] of the second folder: the standard errors of the fit, but at least what repeats.

    `zero_offset_rad` keeps its prior: the fitted offset is not in the model file.
    """
    known_to = dict(before)
    for shift in fit.shifts:
        key = shift.name.rpartition(".")[2]
        known_to[key] = min(shift.std, before[key])
    known_to["zero_offset_rad"] = before["zero_offset_rad"]
    friction = next(size for size in fit.sizes if size.name == "torque_Nm")
    damping = float(mechanism.model.dof_damping[0])
    least = {
        "command_gain_relative": LEAST_GAIN_STD,
        "joint_friction_Nm": LEAST_FRICTION_STD_RELATIVE * friction.value,
        "joint_damping_Nm_s_per_rad": LEAST_DAMPING_STD_RELATIVE * damping,
        "zero_offset_rad": LEAST_ZERO_STD_RAD,
    }
    known_to["joint_friction_Nm"] = friction.std
    for key, least_std in least.items():
        known_to[key] = max(known_to[key], least_std)
    return known_to


def fit_reference(pair, folder, seeds):
    """Fit the reference folder as `rfca-rig fit --effects ... --out fitted.xml` does.

    Returns the fit, what MJCF does not hold of it, and [known_to] for the second folder.
    """
    before = list_known_before(pair.nominal)
    if not (folder / "reference").is_dir():
        recordings = record_all(pair.reference, pair.conditions, seeds)
        model = servos.mjcf(pair.nominal)
        servos.write_campaign(folder / "reference", model, recordings, before, "reference")
    experiment = read_experiment(folder / "reference")
    fitted = MechanismProblem(experiment).fit(FitOptions(effects=FITTED_EFFECTS), ignore_share)
    beyond = write_amended_model(fitted.plant, folder / "fitted.xml")
    mechanism = load_mechanism(folder / "fitted.xml")
    return fitted.fit, beyond, list_known_after(before, fitted.fit, mechanism)


def describe_fit(fit, beyond):
    """Shifts, sizes and errors of the fit of the reference, and what MJCF does not hold of it."""
    shifts = {shift.name: [shift.value, shift.std] for shift in fit.shifts}
    sizes = {f"{size.effect}.{size.name}": [size.value, size.std] for size in fit.sizes}
    errors = {}
    for error in fit.totals:
        errors[error.signal] = [error.nominal, error.fitted, error.held_out]
    return {"shifts": shifts, "sizes": sizes, "errors": errors, "beyond_mjcf": list(beyond)}


def describe(servo):
    """Mass, lever and torque of what hangs on a servo."""
    return {
        "mass_kg": servo.mass_kg,
        "centre_m": servo.centre_m,
        "gravity_Nm": servo.gravity_Nm,
        "weight_kg": servo.weight_kg,
        "arm_m": servo.arm_m,
    }


def describe_model(path):
    """The same of a model file, as far as it is there."""
    model = load_mechanism(path).model
    mass_kg = float(model.body_mass[1])
    centre_m = float(np.linalg.norm(model.body_ipos[1]))
    return {
        "mass_kg": mass_kg,
        "centre_m": centre_m,
        "gravity_Nm": GRAVITY_M_S2 * mass_kg * centre_m,
    }


def refuse(error):
    """The answer where recordings were refused, or a simulation failed."""
    return {
        "grade": "refused",
        "message": str(error),
        "effects": {},
        "family": None,
        "rivals": [],
        "not_seen": {},
        "held_out": {},
        "seconds": 0.0,
        "cpu_s": 0.0,
    }


def diagnose_folder(folder):
    """The answer about a folder as plain values."""
    begun_s = time.perf_counter()
    begun_cpu_s = time.process_time()
    try:
        problem = MechanismProblem(read_experiment(folder))
        result = diagnose(problem, ignore_share).diagnosis
    except RigError as error:
        return refuse(error)
    effects = {}
    for effect in result.effects:
        values = {**effect.parameters, **effect.shape}
        effects[effect.id] = {
            "probability": effect.probability,
            "parameters": {name: [value.value, value.std] for name, value in values.items()},
            "cannot_tell_from": list(effect.cannot_tell_from),
        }
    family = None
    if result.family is not None:
        family = {
            "id": result.family.id,
            "probability": result.family.probability,
            "members": list(result.family.members),
        }
    not_seen = {}
    for effect in result.not_seen:
        limit = effect.would_have_seen
        not_seen[effect.id] = None if limit is None else dict(limit)
    held_out = {}
    for name, figure in result.held_out.items():
        held_out[name] = [figure.before, figure.after, figure.noise_floor]
    moved = {prior.name: prior.deviations for prior in result.moved_priors}
    rivals = [[list(rival.ids), rival.probability] for rival in result.rivals[:RIVALS_KEPT]]
    failed = {c.name: f"{c.found}; {c.required}" for c in result.criteria if not c.passed}
    return {
        "grade": result.grade,
        "probability": result.probability,
        "sentence": result.sentence,
        "effects": effects,
        "family": family,
        "rivals": rivals,
        "not_seen": not_seen,
        "held_out": held_out,
        "failed_criteria": failed,
        "unexplained": list(result.unexplained),
        "moved_priors": moved,
        "seconds": time.perf_counter() - begun_s,
        "cpu_s": time.process_time() - begun_cpu_s,
    }


def answer(seed, number, folder):
    """Truth, fit and answer of a pair, kept in a file."""
    path = folder / f"servo-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    own = folder / f"servo-{number:04d}"
    own.mkdir(exist_ok=True)
    pair = draw(seed, number)
    said = {
        "number": number,
        "kind": pair.kind,
        "conditions": list(pair.conditions),
        "truth": {
            "before": describe(pair.reference),
            "after": describe(pair.changed),
            "friction": asdict(pair.reference.friction),
            "stall_Nm": pair.reference.motor.stall_Nm,
        },
        "nominal": describe(pair.nominal),
        "fit_seconds": 0.0,
    }
    begun_s = time.perf_counter()
    try:
        fit, beyond, known_to = fit_reference(pair, own, [seed, number, 1])
    except RigError as error:
        said |= refuse(error)
    else:
        said["fit_seconds"] = time.perf_counter() - begun_s
        said["fit"] = describe_fit(fit, beyond)
        said["nominal"] = describe_model(own / "fitted.xml")
        said["known_to"] = known_to
        if not (own / "second").is_dir():
            recordings = record_all(pair.changed, pair.conditions, [seed, number, 2])
            model = (own / "fitted.xml").read_text(encoding="utf-8")
            servos.write_campaign(own / "second", model, recordings, known_to, "second")
        said |= diagnose_folder(own / "second")
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def mark(said):
    """right, family, wrong or silent; for an unchanged pair right, law of the servo, or wrong.

    A law that the servo has and its model has not is right beside a body's effect, not alone: the
    change is stated as something else then.
    """
    stated = frozenset(said["effects"])
    family = said["family"]
    if said["kind"] == NOTHING:
        return mark_unchanged(stated, family, said["grade"])
    return mark_changed(stated, family)


def mark_unchanged(stated, family, grade):
    if stated:
        is_of_servo = stated <= LAWS_OF_SERVO
    elif family is not None:
        is_of_servo = members_of(family["id"]) & LAWS_OF_SERVO
    elif grade == "nothing missing":
        return "right"
    else:
        return "silent"
    if is_of_servo:
        return "law of the servo"
    return "wrong"


def mark_changed(stated, family):
    if stated:
        if stated & BODY_EFFECTS and stated <= BODY_EFFECTS | RIGHT_BESIDE_BODY:
            return "right"
        return "wrong"
    if family is not None:
        if members_of(family["id"]) & BODY_EFFECTS:
            return "family"
        return "wrong"
    return "silent"


def change_of_gravity(said):
    """True change of the weight's torque at horizontal, in N m."""
    truth = said["truth"]
    return truth["after"]["gravity_Nm"] - truth["before"]["gravity_Nm"]


def implied_change(said):
    """The same as the stated effects of the body imply it, with its standard deviation.

    None where no such effect is stated.
    """
    mass_kg = said["nominal"]["mass_kg"]
    centre_m = said["nominal"]["centre_m"]
    added_kg = 0.0
    added_std_kg = 0.0
    shift_m = 0.0
    shift_std_m = 0.0
    if not BODY_EFFECTS & set(said["effects"]):
        return None
    if "added_mass" in said["effects"]:
        added_kg, added_std_kg = said["effects"]["added_mass"]["parameters"]["mass_kg"]
    if "centre_of_mass" in said["effects"]:
        shift_m, shift_std_m = said["effects"]["centre_of_mass"]["parameters"]["shift_m"]
    after_Nm = GRAVITY_M_S2 * (mass_kg + added_kg) * (centre_m + shift_m)
    by_mass_Nm = GRAVITY_M_S2 * (centre_m + shift_m) * added_std_kg
    by_shift_Nm = GRAVITY_M_S2 * (mass_kg + added_kg) * shift_std_m
    return after_Nm - said["nominal"]["gravity_Nm"], float(np.hypot(by_mass_Nm, by_shift_Nm))


def is_in_interval(said):
    """Whether the 90 % interval of the implied change holds the true one; None without any."""
    implied = implied_change(said)
    if implied is None:
        return None
    change_Nm, std_Nm = implied
    return abs(change_of_gravity(said) - change_Nm) <= STDS_OF_90 * std_Nm


def excluded_truth(said):
    """The exclusion that the truth contradicts, in words, or an empty text."""
    before = said["truth"]["before"]
    after = said["truth"]["after"]
    added_kg = after["mass_kg"] - before["mass_kg"]
    shift_m = after["centre_m"] - before["centre_m"]
    for effect, key, true in (
        ("added_mass", "mass_kg", added_kg),
        ("centre_of_mass", "shift_m", abs(shift_m)),
    ):
        limit = said["not_seen"].get(effect)
        if limit is not None and key in limit and 0.0 < abs(limit[key]) < true:
            return f"{effect} excluded from {abs(limit[key]):.3g}, true {true:.3g} ({key})"
    return ""


def find_limit(answers):
    """Detection limit as a share of the nominal torque of the weight, and where it comes from."""
    shares = []
    for said in answers:
        limit = said["not_seen"].get("added_mass")
        if said["kind"] == NOTHING and limit is not None:
            shares.append(limit["mass_kg"] / said["nominal"]["mass_kg"])
    if shares:
        return float(np.median(shares)), f"median of {len(shares)} unchanged pairs"
    return ASSUMED_LIMIT, "assumed: three times the torque error"


def print_table(answers):
    """Marks by size of the change relative to its detection limit, and of unchanged pairs."""
    limit, source = find_limit(answers)
    print(f"detection limit: {100 * limit:.1f} % of the weight's torque ({source})")
    print(f"{'change / limit':<18}" + "".join(f"{word:>8}" for word in MARKS) + "  in 90 %")
    changed = [said for said in answers if said["kind"] != NOTHING]
    for kind in (WEIGHT, ARM):
        for low, high in pairwise((*SIZES_IN_LIMITS, np.inf)):
            row = []
            for said in changed:
                share = abs(change_of_gravity(said)) / said["nominal"]["gravity_Nm"]
                if said["kind"] == kind and low <= share / limit < high:
                    row.append(said)
            print_row(f"{kind} {low:g} to {high:g}", row)
    unchanged = Counter(mark(said) for said in answers if said["kind"] == NOTHING)
    print("unchanged: " + ", ".join(f"{word} {count}" for word, count in unchanged.items()))
    exclusions = [said for said in changed if excluded_truth(said)]
    print(f"exclusions that contain the truth: {len(exclusions)} of {len(changed)}")


def print_row(label, row):
    """A row of the table: marks, and how many of the stated sizes hold the truth."""
    counts = Counter(mark(said) for said in row)
    numbers = "".join(f"{counts[word]:>8}" for word in MARKS)
    in_interval = [is_in_interval(said) for said in row]
    stated = [is_inside for is_inside in in_interval if is_inside is not None]
    print(f"{label:<18}{numbers}{f'{sum(stated)} of {len(stated)}':>9}")


def print_misses(answers):
    """A line for each case that is not right, whose size is off, or whose truth is excluded."""
    for said in answers:
        notes = []
        if mark(said) not in ("right", "family"):
            notes.append(mark(said))
        if is_in_interval(said) is False:
            change_Nm, std_Nm = implied_change(said)
            notes.append(f"size {change_Nm:+.3f} +- {std_Nm:.3f} N m")
        if excluded_truth(said):
            notes.append(excluded_truth(said))
        if notes:
            share = change_of_gravity(said) / said["truth"]["before"]["gravity_Nm"]
            truth = f"{change_of_gravity(said):+.3f} N m, {100 * share:+.0f} %"
            head = f"pair {said['number']}, {said['kind']} {truth}: {'; '.join(notes)}"
            print(f"{head}; {describe_answer(said)}")


def describe_answer(said):
    """Grade, stated effects or family, and the closest hypothesis, in one line."""
    if said["grade"] == "refused":
        return f"refused: {said['message']}"
    stated = {name: round(effect["probability"], 3) for name, effect in said["effects"].items()}
    if said["family"]:
        family = said["family"]["id"]
    else:
        family = "nothing stated"
    ids, probability = said["rivals"][0]
    closest = " + ".join(ids) or NOTHING
    return f"{said['grade']}, {stated or family}, closest {closest} ({probability:.2f})"


def make_own_law(usual):
    """The lab's own law T = c |w|^n sgn w of the joint, c at 1 rad/s.

    c may be 0.2 to 80 % of the usual torque, as sizes of the catalogue's laws may.
    """
    torque_Nm = float(usual.torque[0])
    speed_rad_s = np.linspace(-OWN_LAW_FASTEST_RAD_S, OWN_LAW_FASTEST_RAD_S, OWN_LAW_KNOTS)

    def apply(plant, values):
        size_Nm = values["coefficient_Nm"] * np.abs(speed_rad_s) ** values["power"]
        law = JointLaw(
            joint=0,
            by_speed=True,
            knots=speed_rad_s,
            values=np.sign(speed_rad_s) * size_Nm,
            branches=np.zeros(OWN_LAW_KNOTS),
        )
        plant.laws = (*plant.laws, law)
        return plant

    size = Parameter("coefficient_Nm", 0.002 * torque_Nm, 0.8 * torque_Nm, may_be_zero=False)
    power = Parameter("power", 1.2, 1.8, may_be_zero=False)
    return Effect(
        id=OWN_LAW,
        where="joints",
        left_out="friction that grows with a power of the speed",
        law="T = c |w|^n sgn(w), w in rad/s",
        families=(OWN_LAW_FAMILY,),
        source="the lab's own",
        parameters=(size, power),
        apply=apply,
    )


def diagnose_with_own_law(folder):
    """The answer with the own law among the effects of the catalogue."""
    catalogue = prepared.list_effects
    declarations = catalogue_module.declarations
    own_laws = []

    def list_all(mechanism, usual):
        own_laws[:] = [make_own_law(usual)]
        return [*catalogue(mechanism, usual), *own_laws]

    with (
        patch.object(prepared, "list_effects", list_all),
        patch.object(catalogue_module, "declarations", lambda: (*declarations(), *own_laws)),
    ):
        return diagnose_folder(folder)


def answer_own_law(seed, number, folder):
    """Answers about a folder without and with the own law, kept in a file."""
    path = folder / f"own-law-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    random = np.random.default_rng([seed, number, 3])
    servo = draw_servo(random)
    # A fifth to a half of the weight's torque at 2 rad/s, beside dry friction without load.
    power_Nm = random.uniform(0.2, 0.5) * servo.gravity_Nm / 2.0**1.5
    friction = GearFriction(
        dry_Nm=servo.friction.dry_Nm,
        rise=servo.friction.rise,
        falls_rad_s=servo.friction.falls_rad_s,
        bristle_rad=servo.friction.bristle_rad,
        power_Nm=power_Nm,
        power=1.5,
    )
    servo = replace(servo, friction=friction)
    conditions = draw_conditions(random)
    own = folder / f"own-law-{number:04d}"
    if not own.is_dir():
        known_to = {
            "mass_relative": MASS_STD_RELATIVE,
            "zero_offset_rad": ZERO_STD_RAD,
            "command_gain_relative": LEAST_GAIN_STD,
            "torque_error_relative": TORQUE_ERROR_RELATIVE,
        }
        recordings = record_all(servo, conditions, [seed, number, 4])
        servos.write_campaign(own, servos.mjcf(servo), recordings, known_to, "own law")
    said = {
        "number": number,
        "conditions": list(conditions),
        "truth": {"friction": asdict(friction), "gravity_Nm": servo.gravity_Nm},
        "without": diagnose_folder(own),
        "with": diagnose_with_own_law(own),
    }
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def list_slot(said):
    """All effects that act like what is stated."""
    if said["effects"]:
        return list_related(said["effects"])
    if said["family"]:
        return members_of(said["family"]["id"])
    return frozenset()


def mark_own_law(said):
    """stated, same slot, other slot, or silent, of the answer with the own law in the folder.

    Its slot is that of the laws of friction.
    """
    answer_with = said["with"]
    if OWN_LAW in answer_with["effects"]:
        if set(answer_with["effects"]) <= OWN_LAW_RIGHT:
            return "stated"
        return "other slot"
    slot = list_slot(answer_with)
    slot_without = list_slot(said["without"])
    if not slot:
        if slot_without:
            return "silent"
        return "silent as without"
    if slot & (slot_without or OWN_LAW_RIGHT):
        return "same slot"
    return "other slot"


def print_own_law(answers):
    """Counts, and a line for each case."""
    counts = Counter(mark_own_law(said) for said in answers)
    print("with the own law: " + ", ".join(f"{word} {n}" for word, n in counts.items()))
    for said in answers:
        friction = said["truth"]["friction"]
        truth = f"dry {friction['dry_Nm']:.3f} N m, c {friction['power_Nm']:.3f} N m"
        print(f"case {said['number']}: {mark_own_law(said)}; {truth}")
        for way in ("without", "with"):
            print(f"  {way}: {describe_answer(said[way])}")
            limit = said[way]["not_seen"].get("joint_friction")
            if limit is not None and limit["torque_Nm"] < friction["dry_Nm"]:
                print(f"    excluded: dry friction from {limit['torque_Nm']:.3f} N m")
            for name, effect in said[way]["effects"].items():
                for key, (value, std) in effect["parameters"].items():
                    print(f"    {name}.{key} {value:.3g} +- {std:.2g}")


def main():
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--own-law", action="store_true")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    work = answer_own_law if asked.own_law else answer
    # One after the other: a diagnosis uses all cores itself.
    answers = [work(asked.seed, number, asked.folder) for number in range(asked.pairs)]
    if asked.own_law:
        print_own_law(answers)
        return
    print_table(answers)
    print_misses(answers)
    fit_s = np.median([said["fit_seconds"] for said in answers])
    diagnosis_s = np.median([said["seconds"] for said in answers])
    print(f"median seconds of a pair: fit {fit_s:.0f}, diagnosis {diagnosis_s:.0f}")


if __name__ == "__main__":
    main()

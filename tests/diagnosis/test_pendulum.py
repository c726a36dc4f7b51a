"""The diagnosis of pendulums, on recordings of real ones with physics left out of the nominal
model, and on some that an independent integrator made.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.space import never_below
from rfca_rig.campaign.opening import open_experiment
from rfca_rig.campaign.pendulum import LinkSection
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.experiment_design.mechanism_experiment import _releases
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.exam.pendulums.world import Friction, PendulumWorld
from rfca_rig.model.parameters import PresentEffect
from tests.diagnosis.pendulum_folders import (
    link_of,
    release,
    sine,
    write_experiment,
    write_pendulum,
)
from tests.public_recordings import write_public_pendulum

FRICTION_Nm = 0.17  # what the authors' runs with the light weight say
DISSIPATION = {
    "joint_friction",
    "joint_stribeck",
    "joint_hysteresis",
    "joint_damping",
    "joint_drag",
    "fluid_drag",
}


def diagnosed(folder, without=()):
    shares = []
    problem = MechanismProblem(open_experiment(folder))
    answer = diagnose(problem, lambda _, share: shares.append(share), without).diagnosis
    assert shares == sorted(shares)
    return answer


def all_effects_but(folder, *kept):
    """Ids of the effects that are not looked for."""
    effects = MechanismProblem(open_experiment(folder)).list_effects()
    return [effect.id for effect in effects if effect.id not in kept]


@pytest.fixture(scope="module")
def simple(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simple")
    return diagnosed(write_public_pendulum("dfki-pendulum/simple", folder))


@pytest.mark.slow
def test_friction_left_out_of_a_real_pendulum_is_stated_as_its_family(simple):
    """Two swing-ups do not tell the laws of dry friction apart, nor from damping if the model errs
    by some percent.
    """
    assert simple.grade == "family" and simple.family.id == "joint_dissipation"
    assert set(simple.rivals[0].ids) <= DISSIPATION | {"joint_load_friction"}
    removed = [1.0 - (figure.after / figure.before) ** 2 for figure in simple.held_out.values()]
    assert min(removed) > 0.45
    assert not {"joint_friction", "joint_stribeck"} & {other.id for other in simple.not_seen}


@pytest.mark.slow
def test_what_is_printed_beside_the_name_hangs_together(simple):
    named = [effect.id for effect in simple.effects]
    assert [present.id for present in simple.found_effects] == named
    assert all(figure.after < 0.3 * figure.before for figure in simple.fit.values())
    assert all(figure.after < 0.75 * figure.before for figure in simple.held_out.values())
    signals = {"joint1_position_rad", "joint1_speed_rad_s"}
    assert {overlay.signal for overlay in simple.overlays} == signals
    assert not set(named) & {other.id for other in simple.not_seen}


@pytest.mark.slow
def test_where_the_friction_is_believed_nothing_is_claimed_of_the_same_recordings(tmp_path):
    folder = write_public_pendulum("dfki-pendulum/simple", tmp_path)
    text = (folder / "pendulum.toml").read_text(encoding="utf-8")
    text = text.replace("[known_to]", f"joint_friction_Nm = {FRICTION_Nm}\n[known_to]", 1)
    (folder / "pendulum.toml").write_text(text, encoding="utf-8")
    answer = diagnosed(folder)
    assert (answer.grade in ("nothing missing", "unexplained"), answer.effects) == (True, ())


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    folder = tmp_path_factory.mktemp("free-swing")
    return diagnosed(write_public_pendulum("pendulums/free-swing", folder))


@pytest.mark.slow
def test_a_real_rod_that_nothing_drives_loses_energy_by_some_friction_or_drag(free):
    assert set(free.rivals[0].ids) <= DISSIPATION
    assert "torque_scale" not in free.settings["effects_tried"]


@pytest.mark.slow
def test_a_real_rod_that_nothing_drives_is_said_to_dissipate_in_its_joint(free):
    assert states_only(free, DISSIPATION, "joint_dissipation")
    (held_out,) = free.held_out.values()
    # Over windows of up to 2 s, of swings that were not fitted.
    assert held_out.after < 0.2 * held_out.before


def states_only(answer, effects, family):
    """Whether something is stated, and nothing but some of these effects or this family."""
    stated = {effect.id for effect in answer.effects}
    if answer.grade in ("identified", "mostly"):
        return bool(stated) and stated <= effects
    return answer.grade == "family" and answer.family.id == family


@pytest.mark.long
def test_a_real_weight_that_was_added_or_a_scale_that_does_the_same_is_what_it_behaves_like(
    tmp_path,
):
    answer = diagnosed(write_public_pendulum("dfki-pendulum/simple-heavier", tmp_path))
    alike = [
        rival.probability
        for rival in answer.rivals
        if {"added_mass", "torque_scale"} & set(rival.ids)
    ]
    assert sum(alike) > 0.95


@pytest.mark.long
def test_friction_left_out_of_a_real_double_pendulum_is_what_it_behaves_like(tmp_path):
    answer = diagnosed(write_public_pendulum("dfki-pendulum/double", tmp_path))
    assert DISSIPATION & set(answer.rivals[0].ids)
    assert answer.grade == "unexplained" or states_only(
        answer, DISSIPATION | {"joint_inertia"}, "joint_dissipation"
    )


WORLD = PendulumWorld((0.5,), (0.6,), (0.4,), (0.11,), (0.004,))
NOMINAL = (link_of(WORLD),)
KNOWN_TO = {"mass_relative": 0.02, "joint_damping_Nm_s_per_rad": 0.005, "torque_offset_Nm": 0.02}
DRIVEN = (sine(1.2, 5.0), sine(1.2, 6.0))


@pytest.mark.slow
def test_of_a_simulated_pendulum_nothing_is_claimed_where_believed_values_alone_are_off(tmp_path):
    world = replace(
        WORLD, mass_kg=(1.03 * 0.6,), inertia_kg_m2=(1.03 * 0.11,), torque_offset_Nm=(0.02,)
    )
    folder = write_pendulum(tmp_path / "p", NOMINAL, world, DRIVEN, KNOWN_TO)
    assert diagnosed(folder).verdict == "nothing missing"


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect_id", "name", "value", "changes"),
    [
        ("joint_inertia", "inertia_kg_m2", 0.02, {"rotor_kg_m2": 0.02}),
        ("added_mass", "mass_kg", 0.15, {"tip_mass_kg": 0.15}),
        ("joint_friction", "torque_Nm", 0.1, {"friction": Friction((0.1,))}),
        ("torque_lag", "time_constant_s", 0.02, {"torque_lag_s": 0.02}),
        ("speed_lag", "time_constant_s", 0.01, {"speed_lag_s": 0.01}),
        ("angle_lag", "time_constant_s", 0.01, {"angle_lag_s": 0.01}),
    ],
)
def test_in_a_simulated_pendulum_what_was_left_out_is_named_or_one_that_cannot_be_told_from_it(
    tmp_path, effect_id, name, value, changes
):
    world = replace(WORLD, **changes)
    runs = (*DRIVEN, release(2.0))
    answer = diagnosed(write_pendulum(tmp_path / "p", NOMINAL, world, runs, KNOWN_TO))
    assert effect_id in answer.rivals[0].ids
    if answer.grade == "family":
        assert effect_id in answer.family.members
    if not answer.effects:
        return
    (effect,) = answer.effects
    assert effect_id in (effect.id, *effect.cannot_tell_from)
    if effect_id == effect.id:
        assert effect.parameters[name].value == pytest.approx(value, rel=0.15)


@pytest.mark.slow
def test_too_short_a_recording_is_not_enough_data(tmp_path):
    world = replace(WORLD, friction=Friction((0.1,)))
    runs = (sine(1.2, 5.0, seconds=1.8),)
    folder = write_pendulum(tmp_path / "p", NOMINAL, world, runs, KNOWN_TO)
    assert diagnosed(folder).verdict == "not enough data"


@pytest.mark.slow
def test_without_a_driven_run_no_effect_of_the_torque_is_looked_for(tmp_path):
    runs = (release(2.0), release(1.0))
    answer = diagnosed(write_pendulum(tmp_path / "p", NOMINAL, WORLD, runs, KNOWN_TO))
    assert answer.verdict == "nothing missing"
    tried = set(answer.settings["effects_tried"])
    assert "joint_friction" in tried
    assert not tried & {
        "torque_scale",
        "torque_delay",
        "torque_lag",
        "joint_load_friction",
        "angle_lag",
        "joint_friction_of_one",
    }


def test_an_offset_of_the_torque_acts_while_the_motors_are_on(tmp_path):
    runs = (sine(1.2, 5.0), release(1.0))
    folder = write_pendulum(tmp_path / "p", NOMINAL, WORLD, runs, KNOWN_TO)
    problem = prepare_mechanism(open_experiment(folder), open_experiment(folder).load_model())
    space = problem.space
    names = list(space.names)
    shifted = space.at(np.array([float(name == "joint1.torque_offset_Nm") for name in names]))
    nominal = space.at(np.zeros(len(names)))
    changes = {}
    for condition in problem.conditions:
        change = problem.simulator.simulate(shifted, condition) - problem.simulator.simulate(
            nominal, condition
        )
        changes.setdefault(condition.run, []).append(float(np.abs(change).max()))
    assert max(changes["run 1"]) > 1e-3
    assert max(changes["run 2"]) == 0.0


def test_releases_keep_to_the_recorded_range(tmp_path):
    runs = (release(2.0), release(1.0))
    folder = write_pendulum(tmp_path / "p", NOMINAL, WORLD, runs, KNOWN_TO)
    problem = prepare_mechanism(open_experiment(folder), open_experiment(folder).load_model())
    designs = list(_releases(problem))
    assert {design.settings["kind"] for design in designs} == {"release"}
    simulated = [design.simulate(MechanismInput()) for design in designs]
    assert all(motions is not None for motions in simulated)
    for motions in simulated:
        positions = np.concatenate([each.window.measured[0] for each in motions.windows])
        assert positions.min() > problem.usual.lowest[0] - 0.3
        assert positions.max() < problem.usual.highest[0] + 0.3
    # Gravity from the side swings it farther than it was ever seen.
    aside = (("about_x_rad", 0.0), ("about_y_rad", 1.5))
    tilted = MechanismInput(effects=(PresentEffect("gravity_tilt", aside),))
    assert None in [design.simulate(tilted) for design in designs]


# A light, a usual and a heavy rod on a bearing.
RODS = {
    "light": PendulumWorld((0.2,), (0.05,), (0.1,), (6.7e-4,), (0.0,)),
    "usual": PendulumWorld((0.5,), (0.6,), (0.4,), (0.11,), (0.0,)),
    "heavy": PendulumWorld((1.0,), (3.0,), (0.7,), (1.8,), (0.0,)),
}
ENCODER_STEP_RAD = 2.0 * np.pi / 4096
# Of the weight's torque at the usual speed of a swing: an amplitude falls by a third within 5 s.
LOSS = 0.03


@pytest.mark.slow
@pytest.mark.parametrize("write", [write_pendulum, write_experiment], ids=["pendulum", "mechanism"])
@pytest.mark.parametrize("law", ["joint_damping", "joint_drag"])
@pytest.mark.parametrize("rod", RODS)
def test_damping_and_drag_of_a_released_rod_are_ranked_rightly(tmp_path, rod, law, write):
    world = RODS[rod]
    length_m = world.length_m[0]
    torque_Nm = 9.81 * world.mass_kg[0] * world.centre_m[0]
    speed_rad_s = float(np.sqrt(torque_Nm / world.inertia_kg_m2[0]))
    if law == "joint_damping":
        true = replace(world, damping_Nm_s_per_rad=(LOSS * torque_Nm / speed_rad_s,))
    else:
        # A link in the exam's fluid feels c L (L / 2)^3 w^2.
        true = replace(
            world, drag_N_s2_per_m3=8.0 * LOSS * torque_Nm / (speed_rad_s**2 * length_m**4)
        )
    runs = [release(angle_rad, seconds=4.0) for angle_rad in (0.8, 1.6, 2.4)]
    folder = write(
        tmp_path / "p",
        (link_of(world),),
        true,
        runs,
        {"zero_offset_rad": 0.01, "mass_relative": 0.02},
        has_speeds=False,
        step_rad=ENCODER_STEP_RAD,
    )
    answer = diagnosed(folder, all_effects_but(folder, "joint_damping", "joint_drag"))
    assert law in answer.rivals[0].ids
    evidence = {rival.ids: rival.log_evidence for rival in answer.rivals}
    other = ({"joint_damping", "joint_drag"} - {law}).pop()
    if (other,) in evidence:
        assert evidence[(law,)] > evidence[(other,)]


@pytest.mark.slow
def test_both_formats_give_the_same_answer(tmp_path):
    world = replace(WORLD, friction=Friction((0.12,)))
    written = (NOMINAL, world, DRIVEN, KNOWN_TO)
    answers = [
        diagnosed(write(tmp_path / write.__name__, *written))
        for write in (write_pendulum, write_experiment)
    ]
    pendulum, mechanism = answers
    assert pendulum.grade == mechanism.grade
    assert [effect.id for effect in pendulum.effects] == [effect.id for effect in mechanism.effects]
    assert [rival.ids for rival in pendulum.rivals] == [rival.ids for rival in mechanism.rivals]
    for ours, theirs in zip(pendulum.rivals, mechanism.rivals, strict=True):
        assert ours.log_evidence == pytest.approx(theirs.log_evidence, abs=0.05)


@pytest.mark.slow
def test_a_sample_that_jumps_is_left_out_and_the_answer_stays(tmp_path):
    world = replace(WORLD, friction=Friction((0.12,)))
    folder = write_pendulum(tmp_path / "p", NOMINAL, world, DRIVEN, KNOWN_TO)
    without = all_effects_but(folder, "joint_friction", "joint_damping")
    sound = diagnosed(folder, without)
    path = folder / "runs" / "1.csv"
    lines = path.read_text().splitlines()
    cells = lines[500].split(",")
    cells[1] = "9.5"
    lines[500] = ",".join(cells)
    path.write_text("\n".join(lines))
    spoiled = diagnosed(folder, without)
    remark = "signal angle1: 1 sample jumps away and comes back; it is left out: by"
    assert any(text.startswith(remark) for text in spoiled.remarks)
    assert spoiled.grade == sound.grade
    (friction,) = spoiled.effects
    (expected,) = sound.effects
    torque = friction.parameters["torque_Nm"]
    assert torque.value == pytest.approx(expected.parameters["torque_Nm"].value, abs=torque.std)


def test_a_point_mass_and_a_link_without_a_motor_are_a_mechanism(tmp_path):
    link = LinkSection(
        length_m=0.4,
        mass_kg=0.5,
        centre_of_mass_m=0.4,
        inertia_kg_m2=0.5 * 0.4**2,
        driven=False,
    )
    world = PendulumWorld((0.4,), (0.5,), (0.4,), (0.08,), (0.0,))
    folder = write_pendulum(tmp_path / "p", (link,), world, (release(1.0),), KNOWN_TO)
    mechanism = open_experiment(folder).load_model()
    assert mechanism.actuators == () and not mechanism.driven.any()


@pytest.mark.parametrize("nominal", [0.0, 0.01, 0.1])
def test_a_value_that_is_never_negative_stays_so_and_is_moved_as_asked_where_there_is_room(nominal):
    shift = never_below(nominal, 0.01)
    assert all(nominal + shift(by) > 0.0 for by in (-1.0, -0.1, -0.01, 0.0))
    assert shift(0.1) == pytest.approx(0.1, abs=1e-3)
    assert shift(0.0) == pytest.approx(0.0, abs=2e-3)

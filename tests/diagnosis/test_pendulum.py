"""The diagnosis of pendulums, on recordings of real ones with physics left out of the nominal
model, and on simulated ones.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.analysis.fitting.space import never_below
from rfca_rig.analysis.swings import Nuisance, make_swing_problem
from rfca_rig.campaign.pendulum import (
    KnownToPendulum,
    PendulumCampaign,
    PendulumRun,
    read_pendulum_campaign,
)
from rfca_rig.diagnosis.decision.decide import Decision, decide
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.pendulums.diagnose import (
    _build_result,
    _describe_closest,
    diagnose_pendulum,
    search_pendulum,
)
from rfca_rig.diagnosis.pendulums.windows import (
    PendulumInput,
    cut_stretches,
    make_pendulum_problem,
    space_of_pendulum,
)
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.effects.joint_torques import torque_trace
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import Pendulum, PendulumLink, make_driven_pendulum, rods

DATA = Path(__file__).parents[1] / "data" / "dfki-pendulum"
REAL_FREE = Path(__file__).parents[1] / "data" / "pendulums" / "free-swing"
FRICTION_Nm = 0.17  # what the authors' runs with the light weight say


def diagnosed(campaign):
    told = []
    found = diagnose_pendulum(campaign, lambda _, share: told.append(share))
    assert told == sorted(told)
    return found


def with_nominal_friction(campaign):
    links = tuple(replace(link, joint_friction_Nm=FRICTION_Nm) for link in campaign.pendulum.links)
    return replace(campaign, pendulum=Pendulum(links))


@pytest.fixture(scope="module")
def simple():
    return diagnosed(read_pendulum_campaign(DATA / "simple"))


@dataclass(frozen=True)
class Found:
    """What a search finds, what is decided of it, and the answer."""

    found: ModelSelectionResult
    decision: Decision
    answer: Diagnosis


@pytest.fixture(scope="module")
def of_dry_friction():
    """The same recordings, where only the two laws of dry friction are looked for, which takes a
    fraction of the time.
    """
    campaign = read_pendulum_campaign(DATA / "simple")
    others = [
        effect_id
        for effect_id in catalogue()
        if effect_id not in ("joint_friction", "joint_stribeck")
    ]
    problem, found, effects = search_pendulum(
        make_pendulum_problem(campaign), lambda *_: None, others
    )
    decision = decide(found)
    return Found(found, decision, _build_result(problem, found, decision, effects))


@pytest.mark.slow
def test_friction_left_out_of_a_real_pendulum_is_stated_as_its_family(simple):
    """Two swing-ups do not tell the two laws of dry friction apart, nor from damping if the
    model errs by some percent.
    """
    assert simple.grade == "family" and simple.family.id == "joint_dissipation"
    assert {rival.ids for rival in simple.rivals[:2]} == {("joint_friction",), ("joint_stribeck",)}
    removed = [1.0 - (figure.after / figure.before) ** 2 for figure in simple.held_out.values()]
    assert min(removed) > 0.6
    assert not {"joint_friction", "joint_stribeck"} & {other.id for other in simple.not_seen}


@pytest.mark.slow
def test_what_is_printed_beside_the_name_hangs_together(simple):
    named = [effect.id for effect in simple.effects]
    assert [present.id for present in simple.found_effects] == named
    assert [present.id for present in simple.found_rig.effects] == named
    assert all(figure.after < 0.3 * figure.before for figure in simple.fit.values())
    assert all(figure.after < 0.7 * figure.before for figure in simple.held_out.values())
    assert {overlay.signal for overlay in simple.overlays} == {"angle1_rad", "speed1_rad_s"}
    assert not set(named) & {other.id for other in simple.not_seen}


@pytest.mark.slow
def test_where_model_and_recordings_differ_is_located(of_dry_friction):
    found = of_dry_friction.answer
    assert found.located
    assert {place.signal for place in found.located} <= {"angle1_rad", "speed1_rad_s"}
    assert {place.phase for place in found.located} <= {
        "differential dynamic programming",
        "direct collocation",
    }
    assert {cell.condition for cell in found.cells} == {
        part for overlay in found.overlays for part in overlay.parts
    }


def check_proposal(proposal):
    one, other, expected = proposal["separates"][0]
    assert {one, other} == {"joint_friction", "joint_stribeck"}
    assert expected > 3.0
    assert proposal["kind"] in ("release", "sine torque")
    assert proposal["protocol"] is None


@pytest.mark.slow
def test_two_laws_of_friction_are_told_apart_by_an_experiment_within_what_the_rig_has_done(
    of_dry_friction,
):
    check_proposal(of_dry_friction.answer.next_experiment)


@pytest.mark.slow
def test_of_all_effects_the_two_laws_of_friction_are_told_apart_by_an_experiment(simple):
    check_proposal(simple.next_experiment)


@pytest.fixture(scope="module")
def free():
    return diagnosed(read_pendulum_campaign(REAL_FREE))


@pytest.mark.slow
def test_a_real_rod_that_nothing_drives_loses_energy_by_some_friction_or_drag(free):
    dissipation = {"hinge_viscous_damping", "joint_friction", "joint_stribeck", "fluid_drag"}
    assert set(free.rivals[0].ids) <= dissipation
    assert "torque_scale" not in free.settings["effects_tried"]


@pytest.mark.slow
def test_a_real_rod_that_nothing_drives_is_said_to_dissipate_in_its_joint(free):
    assert states_only(
        free, {"hinge_viscous_damping", "joint_friction", "joint_stribeck"}, "joint_dissipation"
    )


def check_held_out(unexplained):
    (text,) = [each for each in unexplained if "rms on held-out stretches falls" in each]
    figures = re.findall(r"(\S+) to ([\d.e-]+)", text)
    assert figures and all(float(after) < 0.6 * float(before) for before, after in figures)


@pytest.mark.slow
def test_what_is_not_claimed_says_how_much_of_the_held_out_error_it_would_take_away(free):
    assert free.verdict == "unexplained"
    check_held_out(free.unexplained)


@pytest.mark.slow
def test_a_closest_effect_that_is_not_stated_comes_with_the_held_out_error_that_it_removes(
    of_dry_friction,
):
    found = of_dry_friction.found
    decision = of_dry_friction.decision
    closest = replace(decision, effects=(), closest=found.named[0])
    check_held_out(_describe_closest(found, closest))
    assert _describe_closest(found, replace(closest, closest=None)) == ()


@pytest.mark.slow
def test_where_the_friction_is_believed_nothing_is_claimed_of_the_same_recordings():
    found = diagnosed(with_nominal_friction(read_pendulum_campaign(DATA / "simple")))
    assert (found.verdict, found.effects) == ("nothing missing", ())


@pytest.mark.long
def test_a_real_weight_that_was_added_or_a_scale_that_does_the_same_is_what_it_behaves_like():
    found = diagnosed(read_pendulum_campaign(DATA / "simple-heavier"))
    alike = [
        rival.probability
        for rival in found.rivals
        if {"added_mass", "torque_scale"} & set(rival.ids)
    ]
    assert sum(alike) > 0.95


def states_only(found, effects, family):
    """Whether something is stated, and nothing but some of these effects or this family."""
    stated = {effect.id for effect in found.effects}
    if found.grade in ("identified", "mostly"):
        return bool(stated) and stated <= effects
    return found.grade == "family" and found.family.id == family


THREE_PUBLISHED_SETS_AGREE_TO = {
    "mass_relative": 0.2,
    "centre_of_mass_m": 0.02,
    "joint_damping_Nm_s_per_rad": 0.01,
    "torque_error_relative": 0.03,
}


@pytest.mark.long
def test_friction_and_rotors_left_out_of_a_real_double_pendulum_are_stated():
    campaign = replace(
        read_pendulum_campaign(DATA / "double"), known_to=THREE_PUBLISHED_SETS_AGREE_TO
    )
    found = diagnosed(campaign)
    assert states_only(
        found, {"joint_friction", "joint_stribeck", "joint_inertia"}, "joint_dissipation"
    )


@pytest.mark.long
def test_friction_and_rotors_left_out_of_a_real_double_pendulum_are_what_it_behaves_like():
    found = diagnosed(read_pendulum_campaign(DATA / "double"))
    alike = ({"joint_friction", "joint_inertia"}, {"joint_stribeck", "joint_inertia"})
    assert set(found.rivals[0].ids) in alike
    of_alike = 0.0
    for rival in found.rivals:
        if any(pair <= set(rival.ids) for pair in alike):
            of_alike += rival.probability
    assert of_alike > 0.99
    assert found.grade == "unexplained" or states_only(
        found, {"joint_friction", "joint_stribeck", "joint_inertia"}, "joint_dissipation"
    )


BELIEVED = Pendulum((PendulumLink(0.5, 0.6, 0.4, 0.11, 0.004),))
KNOWN_TO = {"mass_relative": 0.02, "joint_damping_Nm_s_per_rad": 0.005, "torque_offset_Nm": 0.02}
ANGLE_NOISE = 5e-4
SPEED_NOISE = 0.02


def simulated(*effects: PresentEffect, pendulum: Pendulum = BELIEVED) -> PendulumCampaign:
    return PendulumCampaign(
        "simulated",
        BELIEVED,
        KNOWN_TO,
        {"angle_rad": ANGLE_NOISE, "speed_rad_s": SPEED_NOISE},
        tuple(recorded(seed, pendulum, effects) for seed in (1, 2)),
    )


def recorded(seed: int, pendulum: Pendulum, effects: tuple[PresentEffect, ...]) -> PendulumRun:
    random = np.random.default_rng(seed)
    t_s = np.arange(0.0, 4.3, 0.004)
    torque = 1.2 * np.sin((4.0 + seed) * t_s + seed)[:, None]
    after = make_driven_pendulum(pendulum, effects).swing(
        torque_trace(t_s, torque), np.array([0.8]), np.zeros(1), t_s[1:]
    )
    angle = np.append(0.8, after.angle_rad)[:, None]
    speed = np.append(0.0, after.speed_rad_s)[:, None]
    noisy = (
        angle + random.normal(0, ANGLE_NOISE, angle.shape),
        speed + random.normal(0, SPEED_NOISE, speed.shape),
    )
    return PendulumRun(f"sine {seed}, repeat 1", f"sine {seed}", 1, t_s, *noisy, torque)


@pytest.mark.slow
def test_of_a_simulated_pendulum_nothing_is_claimed_where_believed_values_alone_are_off():
    link = BELIEVED.links[0]
    other = Pendulum(
        (
            replace(
                link,
                mass_kg=1.03 * link.mass_kg,
                inertia_kg_m2=1.03 * link.inertia_kg_m2,
                torque_offset_Nm=0.02,
            ),
        )
    )
    assert diagnosed(simulated(pendulum=other)).verdict == "nothing missing"


@pytest.mark.long
@pytest.mark.parametrize(
    ("id_", "name", "value"),
    [
        ("joint_inertia", "inertia_kg_m2", 0.02),
        ("added_mass", "mass_kg", 0.15),
        ("joint_friction", "torque_Nm", 0.1),
    ],
)
def test_in_a_simulated_pendulum_what_was_left_out_is_named_or_one_that_cannot_be_told_from_it(
    id_, name, value
):
    found = diagnosed(simulated(PresentEffect(id_, ((name, value),))))
    (effect,) = found.effects
    assert id_ in (effect.id, *effect.cannot_tell_from)
    if id_ == effect.id:
        assert effect.parameters[name].value == pytest.approx(value, rel=0.1)


@pytest.mark.slow
def test_too_short_a_recording_is_not_enough_data():
    campaign = simulated(PresentEffect("joint_friction", (("torque_Nm", 0.1),)))
    run = campaign.runs[0]
    kept = run.t_s < 1.8
    short = replace(
        run,
        t_s=run.t_s[kept],
        angle_rad=run.angle_rad[kept],
        speed_rad_s=run.speed_rad_s[kept],
        torque_Nm=run.torque_Nm[kept],
    )
    assert diagnosed(replace(campaign, runs=(short,))).verdict == "not enough data"


def test_rows_lie_beside_what_the_model_says_of_them():
    problem = make_swing_problem(simulated(), 0.5, 0.05)
    stretches = cut_stretches(problem)
    assert len(stretches) == 4
    assert stretches[0].named == "sine 1, repeat 1, 0.1 to 2.1 s"
    supposed = space_of_pendulum(BELIEVED, problem.nuisances).at(np.zeros(3))
    for stretch in stretches:
        rows = stretch.rows()
        usual = np.hypot(rows.noise, 0.01 * rows.scale)
        assert np.sqrt(np.mean(((rows.measured - stretch.simulated(supposed)) / usual) ** 2)) < 1.0


def test_every_nuisance_parameter_has_the_unit_of_its_key():
    keys = [key for key in KnownToPendulum.model_fields if key != "torque_error_relative"]
    space = space_of_pendulum(BELIEVED, [Nuisance(f"link1.{key}", 0.1) for key in keys])
    units = dict(zip(keys, (parameter.unit for parameter in space.parameters), strict=True))
    spelled = {
        key: unit.replace("N m", "Nm").replace("/", " per ").replace(" ", "_")
        for key, unit in units.items()
    }
    assert [key for key in keys if not key.endswith(spelled[key])] == []
    assert all(bool(units[key]) != key.endswith("_relative") for key in keys)


@pytest.mark.parametrize("which", [0, 1], ids=["angle", "speed"])
def test_what_an_uncertain_start_does_is_taken_off_as_far_as_it_can_be_told_from_noise(which):
    first = cut_stretches(make_swing_problem(simulated(), 0.5, 0.05))[0].windows[0]
    ready = make_driven_pendulum(BELIEVED)
    effect = first.window.start_effect[which]
    usual = np.hypot(first.window.sensor_std, 0.01 * first.scale)
    told = np.sum((effect / usual) ** 2)
    moved = replace(
        first, window=replace(first.window, measured=first.window.predicted(ready) + effect)
    )
    left = moved.window.measured - moved.predicted(ready)
    assert np.linalg.norm(left / usual) < 1.5 / (1.0 + told) * np.linalg.norm(effect / usual)


def test_the_model_s_error_grows_as_a_wrong_torque_makes_it_grow():
    window = cut_stretches(make_swing_problem(simulated(), 0.5, 0.05))[0].windows[0]
    t_s = window.window.middles_s
    growth = window.scale[0, 0] / t_s**2
    assert growth[2:5] == pytest.approx(growth[1], rel=0.1)
    torque_Nm = 2.0 * growth[1] * 0.11
    assert (
        0.8 < torque_Nm < 3.0
    )  # weight 9.81 * 0.24 N m times the sine of the angle, and the drive


def test_effects_of_a_supposed_pendulum_are_in_its_rig():
    problem = make_swing_problem(simulated(), 0.5, 0.05)
    stretch = cut_stretches(problem)[0]
    plain = PendulumInput(rods(BELIEVED))
    friction = replace(
        plain,
        rig=replace(plain.rig, effects=(PresentEffect("joint_friction", (("torque_Nm", 0.3),)),)),
    )
    assert np.abs(stretch.simulated(friction) - stretch.simulated(plain)).max() > 0.05
    shifted = replace(plain, off=(("link1.torque_offset_Nm", 0.3),))
    assert np.abs(stretch.simulated(shifted) - stretch.simulated(plain)).max() > 0.05


@pytest.mark.parametrize("nominal", [0.0, 0.01, 0.1])
def test_a_value_that_is_never_negative_stays_so_and_is_moved_as_asked_where_there_is_room(nominal):
    shift = never_below(nominal, 0.01)
    assert all(nominal + shift(by) > 0.0 for by in (-1.0, -0.1, -0.01, 0.0))
    assert shift(0.1) == pytest.approx(0.1, abs=1e-3)
    assert shift(0.0) == pytest.approx(0.0, abs=2e-3)

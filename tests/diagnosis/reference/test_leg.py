"""A leg beside its reference: rows that belong together, and values that have changed."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import read_model_file
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.leg.paired import name_commands, pair_legs
from rfca_rig.diagnosis.leg.problem import LegProblem, list_candidates
from rfca_rig.diagnosis.leg.simulator import NUISANCES_OF_A_DAY
from rfca_rig.diagnosis.opening import open_problem
from rfca_rig.diagnosis.reference.changes import add_changes, make_change
from rfca_rig.diagnosis.reference.matching import find_matches, find_repeats
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.errors import BadInput
from rfca_rig.exam.cases import PAPER_CONDITIONS, Case
from rfca_rig.exam.nominal_world import NominalErrors, draw_structured_error
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.model.catalogue import families_of, members_of
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.parameters import PresentEffect
from tests.cli.test_eighty_columns import SMALL

BEFORE = Case(
    id="",
    kind="model error",
    seed=11,
    design=replace(PAPER_CONDITIONS, repeats=2, static_heights_mm=()),
    off=NominalErrors(height_mm=0.1, friction_coefficient=0.03, k0_factor=1.02),
    late_s=0.001,
    structured=draw_structured_error(0.01, np.random.default_rng(3)),
    strangers={"tendon": {"stiffness_Nm_per_rad": 0.15}},
)


@pytest.fixture(scope="module")
def small():
    """Static stages, with strokes that are sampled too coarsely to be used."""
    return read_campaign(SMALL)


@pytest.fixture(scope="module")
def flapping(tmp_path_factory):
    """Two strokes, with the angle of the shaft."""
    folder = tmp_path_factory.mktemp("strokes") / "campaign"
    few = replace(BEFORE.design, conditions=BEFORE.design.conditions[:2], repeats=1)
    write_campaign(replace(BEFORE, design=few), folder)
    return read_campaign(folder)


def begin_later(recording, by_s):
    """The recording without its first samples."""
    strokes = []
    for stroke in recording.strokes:
        streams = {}
        for name, stream in stroke.streams.items():
            kept = stream.t_s >= stream.t_s[0] + by_s
            columns = {
                column: replace(values, data=values.data[kept])
                for column, values in stream.columns.items()
            }
            streams[name] = replace(stream, t_s=stream.t_s[kept], columns=columns)
        strokes.append(replace(stroke, streams=streams))
    return replace(recording, strokes=tuple(strokes))


@pytest.mark.parametrize("later_s", [0.0, 0.06], ids=["as long", "shorter"])
def test_a_recording_has_the_bins_of_its_reference(flapping, later_s):
    paired = pair_legs([flapping], [begin_later(flapping, later_s)])
    assert len(paired.new.flaps) == 2
    new = paired.new_dataset().rows
    reference = paired.reference_dataset().rows
    assert len(new.measured) == len(reference.measured)
    for number in range(int(new.recording.max()) + 1):
        wanted = new.take(np.flatnonzero(new.recording == number))
        (match,) = find_matches(wanted, reference, name_commands)
        assert np.abs(reference.t_s[match.rows] - wanted.t_s).max() < 1e-3
        assert match.distance < 1e-3


def turn_otherwise(recording, by_rad):
    """The recording with a shaft that lags behind, as one of a softer drive does."""
    strokes = []
    for stroke in recording.strokes:
        streams = {}
        for name, stream in stroke.streams.items():
            columns = dict(stream.columns)
            if "shaft_angle_rad" in columns:
                angle = columns["shaft_angle_rad"]
                pulse = np.exp(-(((stream.t_s - 0.5) / 0.1) ** 2))
                columns["shaft_angle_rad"] = replace(angle, data=angle.data - by_rad * pulse)
            streams[name] = replace(stream, columns=columns)
        strokes.append(replace(stroke, streams=streams))
    return replace(recording, strokes=tuple(strokes))


def test_a_drive_that_has_changed_is_not_hidden(flapping):
    assert pair_legs([turn_otherwise(flapping, 1e-4)], [flapping]).new.flaps
    with pytest.raises(BadInput, match="the shaft turns otherwise than in the reference"):
        pair_legs([turn_otherwise(flapping, 0.05)], [flapping])
    # The same deviation in both is that of the drive.
    softer = turn_otherwise(flapping, 0.05)
    assert pair_legs([softer], [softer]).new.flaps


def test_stages_match_their_own_side(small):
    """Friction pulls the other way where an angle is approached from the other side."""
    loading = tuple(stage for stage in small.static if stage.direction == "loading")
    back = tuple(
        replace(stage, direction="unloading", fy_N=stage.fy_N + 0.5) for stage in reversed(loading)
    )
    both = replace(small, static=(*loading, *back))
    paired = pair_legs([both], [both])
    rows = paired.new_dataset().rows
    (match,) = find_matches(rows, paired.reference_dataset().rows, name_commands)
    assert list(match.rows) == list(range(len(rows.measured)))


def test_another_height_is_another_command(small):
    higher = tuple(replace(stroke, height_m=stroke.height_m + 0.005) for stroke in small.strokes)
    stages = tuple(replace(stage, height_m=stage.height_m + 0.005) for stage in small.static)
    paired = pair_legs([small], [replace(small, strokes=higher, static=stages)])
    rows = paired.new_dataset().rows
    for number in range(int(rows.recording.max()) + 1):
        wanted = rows.take(np.flatnonzero(rows.recording == number))
        assert not find_matches(wanted, paired.reference_dataset().rows, name_commands)


def test_two_recordings_of_the_reference_are_repeats(small):
    rows = pair_legs([small], [small, small]).reference_dataset().rows
    ((first, second),) = find_repeats(rows, name_commands)
    assert sorted([*first.rows, *second.rows]) == list(range(len(rows.measured)))


def test_a_change_is_made_in_the_value_and_remembers_the_one_before(small):
    paired = pair_legs([small], [small])
    before = ModelPoint(paired.new.rig)
    changes = (
        PresentEffect("k0_change", (("factor", 0.9),)),
        PresentEffect("friction_change", (("change", 0.05),)),
        PresentEffect("start_angle_change", (("change_deg", 1.0),)),
        PresentEffect("tip_mass", (("mass_g", 2.0),)),
    )
    after = before.with_effects(changes)
    assert after.rig.leg.k0_Nm_per_rad == pytest.approx(0.9 * before.rig.leg.k0_Nm_per_rad)
    friction = before.rig.ground.friction_coefficient
    assert after.rig.ground.friction_coefficient == pytest.approx(friction + 0.05)
    assert after.turn_offset_rad == pytest.approx(np.radians(1.0))
    assert [effect.id for effect in after.rig.effects] == ["tip_mass"]
    assert after.unchanged == before
    assert before.with_effects(changes[-1:]).unchanged is None


def offered(small, known_to, without=()):
    """Ids of all effects beside a reference, where these values are known."""
    paired = pair_legs([replace(small, known_to=known_to)], [small])
    pair = Mock(
        space=paired.new.coordinates.space,
        free=NUISANCES_OF_A_DAY,
        effects=list_candidates(paired.new),
    )
    return [effect.id for effect in add_changes(pair, without)]


def test_values_of_known_to_may_have_changed(small):
    known_to = {"k0_relative": 0.03, "hinge_damping_relative": 0.5, "height_mm": 0.2}
    ids = offered(small, known_to)
    assert set(ids) & VALUE_OF_CHANGE.keys() == {"k0_change", "hinge_damping_change"}
    # More damping is a change of damping; another height has both signs already.
    assert "hinge_viscous_damping" not in ids
    assert "height_offset" in ids
    assert "k0_change" not in offered(small, known_to, ("k0_change",))
    assert "hinge_viscous_damping" in offered(small, {"k0_relative": 0.03})


def test_a_change_belongs_to_the_family_of_its_value():
    assert [family.id for family in families_of("k0_change")] == ["hinge_stiffness"]
    assert "k0_change" in members_of("hinge_stiffness")


def test_a_factor_may_be_as_large_as_it_is_small(small):
    space = pair_legs([small], [small]).new.coordinates.space
    for parameter in space.parameters:
        if f"{parameter.name}_change" in VALUE_OF_CHANGE:
            (size,) = make_change(parameter).parameters
            if size.name == "factor":
                assert size.low * size.high == pytest.approx(1.0)
            else:
                assert size.low == -size.high


WORN = 0.95


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Two recordings of a leg that another simulator moves, with a spring that no effect has."""
    folders = []
    for run in (1, 2):
        folders.append(tmp_path_factory.mktemp("leg") / f"reference {run}")
        write_campaign(replace(BEFORE, seed=run), folders[-1])
    return folders


def diagnose_change(folder, case, reference):
    write_campaign(case, folder)
    problem = ReferenceProblem(open_problem([folder]), open_problem(reference))
    return diagnose(problem, lambda *_: None)


@pytest.mark.slow
def test_the_error_that_both_recordings_have_is_no_change(tmp_path, reference):
    diagnosis = diagnose_change(tmp_path / "new", replace(BEFORE, seed=5), reference).diagnosis
    assert diagnosis.grade == "nothing missing"
    assert "nothing has changed" in diagnosis.sentence
    assert any("4 of 4 parts" in remark for remark in diagnosis.remarks)


@pytest.mark.slow
def test_a_worn_hinge_is_a_change_of_its_stiffness(tmp_path, reference):
    off = replace(BEFORE.off, k0_factor=WORN * BEFORE.off.k0_factor)
    answer = diagnose_change(tmp_path / "new", replace(BEFORE, seed=6, off=off), reference)
    effect = next(iter(answer.diagnosis.effects))
    assert effect.id == "k0_change"
    assert effect.parameters["factor"].value == pytest.approx(WORN, abs=0.005)
    assert "Since the reference" in answer.diagnosis.sentence
    # The model file has the stiffness of today, and is a model as any other.
    answer.write_files(tmp_path)
    model = read_model_file(tmp_path / "model.toml")
    before = answer.diagnosis.believed_values["k0"].value
    after = before * effect.parameters["factor"].value
    assert model.model().leg.k0_Nm_per_rad == pytest.approx(after, rel=1e-6)
    assert {present.id for present in model.effects} <= {"height_offset"}


@pytest.mark.slow
def test_other_conditions_are_no_change(tmp_path, reference):
    other = replace(BEFORE.design, conditions=((205.0, 2.2), (205.0, 3.0), (225.0, 2.6)))
    case = replace(BEFORE, seed=7, design=other)
    answer = diagnose_change(tmp_path / "new", case, reference)
    assert not answer.diagnosis.effects
    assert answer.diagnosis.family is None
    proposal = answer.diagnosis.next_experiment
    assert proposal["kind"] == "repeat of the reference"


def test_a_leg_has_a_problem_of_its_own_kind(small):
    problem = LegProblem((small,))
    with pytest.raises(BadInput, match="same leg"):
        problem.pair_with(Mock(), (), lambda *_: None)

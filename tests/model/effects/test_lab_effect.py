"""An effect from a lab's own folder, as docs/add-an-effect.md describes it."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.diagnosis.leg.drive_search import list_drive_effects
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import (
    FOLDER_VARIABLE,
    catalogue,
    declarations,
    families_of,
    list_effects_like,
    list_related,
    members_of,
)
from rfca_rig.model.effect import LEG_SIDE, MOTOR_SIDE
from rfca_rig.model.families import FAMILIES, FAMILIES_OF_VALUES
from tests.model.effects.rigs import having, paper_stroke, released
from tests.model.legs import pendulum

DOCS = Path(__file__).parents[3] / "docs"
LAB = DOCS / "examples" / "effects"
GUIDE = DOCS / "add-an-effect.md"


def test_a_lab_s_own_effect_damps_as_its_law_says(monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(LAB))
    c = 0.02
    inertia = 0.4 * 0.5**2 / 3
    w0 = 3.0
    t = np.linspace(0.01, 1.0, 100)
    rig = having(pendulum(2, k0=1e-9), cubic_damping={"coefficient_Nm_s3_per_rad3": c})
    w = released(rig, [0.0, 0.0], t, speed_rad_s=w0).w[:, 1]
    assert w == pytest.approx(w0 / np.sqrt(1.0 + 2.0 * c * w0**2 * t / inertia), rel=1e-4)


def test_a_lab_s_own_effect_changes_the_stroke_and_is_gone_without_its_folder(monkeypatch):
    values = {"coefficient_Nm_s3_per_rad3": 0.01}
    plain = paper_stroke()
    monkeypatch.setenv(FOLDER_VARIABLE, str(LAB))
    assert abs(paper_stroke(cubic_damping=values).fz_N - plain.fz_N).max() > 0.1
    monkeypatch.delenv(FOLDER_VARIABLE)
    with pytest.raises(BadInput, match="cubic_damping: not in the catalogue"):
        paper_stroke(cubic_damping=values)


def test_the_guide_shows_the_very_file_that_is_tested():
    assert (LAB / "our_effect.py").read_text() in GUIDE.read_text()


@pytest.mark.parametrize(
    "content", ["def torque(:\n", "import no_such_module\n", "EFFECT = 3\n", "1 / 0\n", ""]
)
def test_a_broken_file_gives_one_line_that_names_it(content, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text(content)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(BadInput, match=r"broken\.py") as refused:
        catalogue()
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("rate**3", "open(rate)"),
        ('values["coefficient_Nm_s3_per_rad3"],', "0.0,) * 9 + ("),
        (", 3.0 * parameter[0] * rate**2", ""),
    ],
)
def test_a_law_that_cannot_be_compiled_or_called_gives_one_line_that_names_its_file(
    old, new, tmp_path, monkeypatch
):
    text = (LAB / "our_effect.py").read_text()
    assert old in text
    (tmp_path / "wrong_law.py").write_text(text.replace(old, new, 1))
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(BadInput, match=r"wrong_law\.py: torque") as refused:
        paper_stroke(cubic_damping={"coefficient_Nm_s3_per_rad3": 0.01})
    assert "\n" not in str(refused.value)


def declare(tmp_path, more, effect_id="cubic_damping"):
    """The lab's own effect, which declares more."""
    text = (LAB / "our_effect.py").read_text()
    assert '    id="cubic_damping"' in text
    (tmp_path / "our_effect.py").write_text(
        text.replace('    id="cubic_damping"', f'    {more},\n    id="{effect_id}"', 1)
    )


def test_a_lab_s_own_effect_may_belong_to_a_family(tmp_path, monkeypatch):
    """Then it is no rival of the family: a statement about the family holds whichever of its
    laws is the true one.
    """
    monkeypatch.setenv(FOLDER_VARIABLE, str(LAB))
    assert [family.id for family in families_of("cubic_damping")] == ["cubic_damping"]
    assert members_of("cubic_damping") == {"cubic_damping"}
    declare(tmp_path, 'family="hinge_dissipation"')
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert {"cubic_damping", "hinge_viscous_damping"} <= members_of("hinge_dissipation")
    assert "cubic_damping" in list_related(("hinge_viscous_damping",))
    monkeypatch.delenv(FOLDER_VARIABLE)
    assert "cubic_damping" not in members_of("hinge_dissipation")


def test_a_family_that_is_not_in_the_catalogue_is_refused(tmp_path, monkeypatch):
    declare(tmp_path, 'family="hinge_disipation"')
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(
        BadInput, match=r"our_effect\.py: family 'hinge_disipation'.*hinge_dissipation"
    ):
        catalogue()


def test_a_lab_s_own_effect_is_a_member_of_all_that_it_declares(tmp_path, monkeypatch):
    declare(
        tmp_path,
        'families=("hinge_dissipation", "spring_memory"), bench_test="bench pull", '
        'encoder="leg side", in_motion_only=True',
    )
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert [family.id for family in families_of("cubic_damping")] == [
        "hinge_dissipation",
        "spring_memory",
    ]
    assert "cubic_damping" in members_of("spring_memory")
    assert {"shaft_play", "cubic_damping"} <= {
        effect.id for effect in list_drive_effects((LEG_SIDE,))
    }
    own = next(effect for effect in declarations() if effect.id == "cubic_damping")
    assert own.in_motion_only
    assert own.bench_test == "bench pull"


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ('bench_test="bench pul"', "bench test 'bench pul'.*bench pull"),
        ('encoder="leg"', "encoder is 'leg'.*leg side"),
    ],
)
def test_a_word_that_means_nothing_is_refused(more, named, tmp_path, monkeypatch):
    declare(tmp_path, more)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(BadInput, match=rf"our_effect\.py: .*{named}"):
        catalogue()


def test_an_effect_in_place_of_one_of_the_package_keeps_what_is_declared_of_it(
    tmp_path, monkeypatch
):
    declare(tmp_path, 'families=("spring_memory",)', effect_id="motor_cogging")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert [family.id for family in families_of("motor_cogging")] == [
        "spring_memory",
        "drive_ripple",
    ]
    cogging = list_drive_effects((MOTOR_SIDE,))[0]
    assert cogging.law == "T = c phi'^3"


def test_a_folder_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "nowhere"))
    with pytest.raises(BadInput, match="nowhere"):
        catalogue()


def test_what_acts_as_a_wrong_nominal_value_does_is_known_by_the_name_of_the_value():
    assert {"added_mass", "centre_of_mass", "joint_inertia"} <= list_effects_like(
        ["arm2.centre_of_mass_m"]
    )
    assert "hinge_viscous_damping" in list_effects_like(["hinge_damping"])
    assert list_effects_like(["shaft.no_such_value"]) == frozenset()
    known = {family.id for family in FAMILIES}
    assert all(known.issuperset(named) for named in FAMILIES_OF_VALUES.values())

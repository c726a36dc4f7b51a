import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field

from rfca_rig.description.model_file import nominal_model
from rfca_rig.description.sections import RigSections
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import Ground, Leg
from rfca_rig.toml import Section, read_toml

RIG = """\
[leg]
link_lengths_mm = [54.0, 40]
link_masses_g = [60.0, 43.0]
link_radius_mm = 3.0
hinge_torque_Nm = "k0*phi + k0*k2*phi**3"
k0_Nm_per_rad = 11.0
k2_per_rad2 = 4.2
hinge_damping_Nm_s_per_rad = 0.05
start_angle_rad = 0.226893

[ground]
contact_stiffness_N_per_m1p5 = 1.0e5
contact_damping_s_per_m = 1
friction_coefficient = 0.45

[sensor]
below_shaft_mm = 45.0
noise_std = { fy_N = 0.10 }

[drive]
ramp_s = 0.05
mode = "speed"
"""


def sections(**changes: dict[str, Any]) -> dict[str, Any]:
    data = tomllib.loads(RIG)
    return {name: {**table, **changes.get(name, {})} for name, table in data.items()}


def refusal(tmp_path: Path, old: str, new: str) -> str:
    path = tmp_path / "rig.toml"
    assert old in RIG
    path.write_text(RIG.replace(old, new, 1))
    with pytest.raises(BadInput) as caught:
        read_toml(path, RigSections)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{tmp_path}/")


def test_the_model_is_in_si_units():
    model = nominal_model(sections())
    assert model.leg == Leg((0.054, 0.04), (0.06, 0.043), 0.003, 11.0, 4.2, 0.05, 0.226893)
    assert (model.sensor.below_shaft_m, model.drive.ramp_s) == (0.045, 0.05)


def test_a_leg_may_be_bent_at_rest_hinge_by_hinge():
    assert nominal_model(sections()).leg.rest_angles_rad == ()
    assert nominal_model(sections(leg={"rest_angles_deg": [-1.5]})).leg.rest_angles_rad == (
        np.radians(-1.5),
    )
    with pytest.raises(
        BadInput, match="rest_angles_deg has 2 angles, and the leg 1 hinges; give one per hinge"
    ):
        nominal_model(sections(leg={"rest_angles_deg": [1.0, 2.0]}))


def test_the_floor_is_coulombs_unless_a_tangential_law_is_given():
    assert nominal_model(sections()).ground == Ground(1e5, 1.0, 0.45, 1e-4, 0.0)
    given = sections(ground={"presliding_mm": 0.05, "tangential_damping_N_s_per_m": 2.0})
    assert nominal_model(given).ground == Ground(1e5, 1.0, 0.45, 5e-5, 2.0)


def test_a_believed_model_that_is_not_one_names_the_key():
    with pytest.raises(
        BadInput, match=r"^the nominal model: leg\.k0_Nm_per_rad: should be greater than 0, not -1$"
    ):
        nominal_model(sections(leg={"k0_Nm_per_rad": -1}))


@pytest.mark.parametrize("law", ["k0 * phi + k0*k2 * phi**3", "k0*phi+k0*k2*phi**3"])
def test_blanks_in_the_hinge_law_do_not_matter(law: str):
    assert nominal_model(sections(leg={"hinge_torque_Nm": law})).leg.k0_Nm_per_rad == 11.0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "friction_coefficient",
            "friction_coeficient",
            "rig.toml:14: ground.friction_coeficient: unknown key; did you mean fr",
        ),
        (
            "k0*k2*phi**3",
            "k3*phi**3",
            (
                'rig.toml:5: leg.hinge_torque_Nm: the only law known is "k0*phi + '
                'k0*k2*phi**3" (phi in rad)'
            ),
        ),
        (
            "[60.0, 43.0]",
            "[60.0]",
            (
                "rig.toml:1: leg: link_lengths_mm names 2 links and link_masses_g 1; give "
                "one mass per length"
            ),
        ),
        (
            "[54.0, 40]",
            "[]",
            "rig.toml:2: leg.link_lengths_mm: should have 1 or more entries, not 0",
        ),
        (
            "[54.0, 40]",
            "[54.0, 0]",
            "rig.toml:2: leg.link_lengths_mm[2]: should be greater than 0, not 0",
        ),
        ("[54.0, 40]", "54.0", "rig.toml:2: leg.link_lengths_mm: should be a list, not 54.0"),
        (
            "ramp_s = 0.05",
            "ramp_s = 0",
            "rig.toml:21: drive.ramp_s: should be greater than 0, not 0",
        ),
        (
            "ramp_s = 0.05",
            "ramp_s = inf",
            "rig.toml:21: drive.ramp_s: should be a finite number, not inf",
        ),
        (
            "ramp_s = 0.05",
            "ramp_s = true",
            "rig.toml:21: drive.ramp_s: should be a number, not True",
        ),
        (
            "ramp_s = 0.05",
            'ramp_s = "0.05"',
            "rig.toml:21: drive.ramp_s: should be a number, not '0.05'",
        ),
        ("ramp_s = 0.05\n", "", "rig.toml:20: drive.ramp_s: missing"),
        ('"speed"', '"torque"', "rig.toml:22: drive.mode: should be 'speed', not 'torque'"),
        (
            "fy_N = 0.10",
            "fy_kN = 0.10",
            "rig.toml:18: sensor.noise_std.fy_kN: unknown key; did you mean fy_N?",
        ),
        (
            "k2_per_rad2 = 4.2",
            "k2_per_rad2 = 4.2\ncolour = 1",
            "rig.toml:8: leg.colour: unknown key; known are link_lengths_mm, ",
        ),
        (
            "[drive]",
            "link_lengths_mm = 3\n[drive]",
            "rig.toml:20: sensor.link_lengths_mm: unknown key; known are below_shaft_mm, ",
        ),
        ("[drive]", "[drive", "rig.toml:20: not TOML at column 7: "),
        (
            "[drive]\n",
            "[motor]\n",
            (
                "rig.toml:20: motor: unknown key; known are leg, ground, sensor, drive, "
                "effects (and 1 more)"
            ),
        ),
    ],
)
def test_what_is_wrong_in_a_file_is_one_line(tmp_path: Path, old: str, new: str, said: str):
    assert refusal(tmp_path, old, new).startswith(said)


def test_a_key_that_is_missing_because_it_was_misspelt_counts_once(tmp_path: Path):
    assert "more)" not in refusal(tmp_path, "ramp_s", "ramp")


HOLD = '[[stages]]\nkind = "hold"\nhold_s = 1\n'


class Hold(Section):
    kind: Literal["hold"]
    hold_s: float


class Sweep(Section):
    kind: Literal["sweep"]
    speed_rad_s: float
    heights: tuple[dict[str, float], ...] = ()


class Plan(Section):
    stages: Annotated[
        tuple[Annotated[Hold | Sweep, Field(discriminator="kind")], ...], Field(strict=False)
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            HOLD + '[[stages]]\nkind = "sweep"\nsped_rad_s = 1\n',
            "6: stages[2].sped_rad_s: unknown key; did you mean speed_rad_s?",
        ),
        (
            '[[stages]]\nkind = "hold"\nhold_s = "1"\n',
            "3: stages[1].hold_s: should be a number, not '1'",
        ),
        ("[[stages]]\nhold_s = 1\n", "1: stages[1]: 'kind' is missing"),
        ('stages = [\n  {kind = "hold"},\n]\n', "1: stages[1].hold_s: missing"),
        ("# no stages\n", ": stages: missing"),
    ],
)
def test_entries_of_any_model_are_counted_from_one_and_found(tmp_path: Path, text: str, said: str):
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(BadInput) as caught:
        read_toml(path, Plan)
    assert (
        str(caught.value).removeprefix(f"{path}").removeprefix(":").lstrip()
        == said.removeprefix(":").lstrip()
    )


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path):
    with pytest.raises(BadInput, match=r"none\.toml: cannot be read: No such file or directory"):
        read_toml(tmp_path / "none.toml", RigSections)


def test_windows_line_ends_and_a_byte_order_mark_are_fine(tmp_path: Path):
    path = tmp_path / "rig.toml"
    path.write_bytes(b"\xef\xbb\xbf" + RIG.replace("\n", "\r\n").encode())
    assert read_toml(path, RigSections).drive.ramp_s == 0.05

"""Folders of other people's strokes: `init --data` drafts a campaign that reads them with the right
values, asks for what cannot be known, or the reader refuses with the true cause.

Each variant states what must come out. A campaign that is read with other values fails, whatever
was said on the way.
"""

import itertools
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from rfca_rig.campaign.leg_draft import write_leg_draft
from rfca_rig.campaign.plausibility import find_slips
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.cli.paths import find_shipped
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_data
from tests.campaign.foreign import Format, Written, write_folder
from tests.campaign.small import SMALL

# By quantity: how labs call it. Each set has another way to state a unit, "%" in a name.
BRACKETS = {
    "t_s": "Time [%]",
    "shaft_angle_rad": "Shaft angle [%]",
    "shaft_speed_rad_s": "Shaft speed [%]",
    "motor_torque_Nm": "Motor torque [%]",
    "fy_N": "Fy [%]",
    "fz_N": "Fz [%]",
    "tx_Nm": "Tx [%]",
}
GERMAN = {
    "t_s": "Zeit (%)",
    "shaft_angle_rad": "Winkel Stütze (%)",
    "shaft_speed_rad_s": "Drehzahl (%)",
    "motor_torque_Nm": "Drehmoment Motor (%)",
    "fy_N": "Kraft Y (%)",
    "fz_N": "Kraft Z (%)",
    "tx_Nm": "Moment X (%)",
}
SLASHES = {
    "t_s": "t/%",
    "shaft_angle_rad": "theta/%",
    "shaft_speed_rad_s": "omega/%",
    "motor_torque_Nm": "tau/%",
    "fy_N": "F_y/%",
    "fz_N": "F_z/%",
    "tx_Nm": "M_x/%",
}
CAMEL = {
    "t_s": "TimeStamp {%}",
    "shaft_angle_rad": "EncoderPosition {%}",
    "shaft_speed_rad_s": "EncoderVelocity {%}",
    "motor_torque_Nm": "MotorTorque {%}",
    "fy_N": "ForceY {%}",
    "fz_N": "ForceZ {%}",
    "tx_Nm": "TorqueX {%}",
}
WORDS = {
    "t_s": "elapsed time in %",
    "shaft_angle_rad": "motor position in %",
    "shaft_speed_rad_s": "angular velocity in %",
    "motor_torque_Nm": "tau in %",
    "fy_N": "y force in %",
    "fz_N": "z force in %",
    "tx_Nm": "moment x in %",
}
UNDERSCORES = {
    "t_s": "time_%",
    "shaft_angle_rad": "shaft_pos_%",
    "shaft_speed_rad_s": "shaft_vel_%",
    "motor_torque_Nm": "motor_trq_%",
    "fy_N": "force_y_%",
    "fz_N": "force_z_%",
    "tx_Nm": "torque_x_%",
}
# Without a unit: a row of units, an attribute, or nothing states it.
BARE = {known: name.removesuffix("_%") for known, name in UNDERSCORES.items()}
OURS = {
    **{"t_s": "s", "shaft_angle_rad": "rad", "shaft_speed_rad_s": "rad/s"},
    **{"motor_torque_Nm": "Nm", "fy_N": "N", "fz_N": "N", "tx_Nm": "Nm"},
}
LOGGER = {
    **{"t_s": "ms", "shaft_angle_rad": "deg", "shaft_speed_rad_s": "rpm"},
    **{"motor_torque_Nm": "Nmm", "fy_N": "kN", "fz_N": "kN", "tx_Nm": "mNm"},
}
IMPERIAL = {**OURS, "t_s": "us", "shaft_angle_rad": "turn", "fy_N": "lbf", "fz_N": "lbf"}
SPELT = {"rad/s": "rad_s", "deg/s": "deg_s"}

TEXT = {
    "commas": {},
    "semicolons": {"separator": ";", "decimal": ","},
    "tabs": {"separator": "\t"},
    "tabs and decimal commas": {"separator": "\t", "decimal": ","},
    "preamble": {"separator": ";", "preamble": ("Logger 7", "Date;2026-05-01", "")},
    "gzip": {"kind": "csv.gz"},
    "Windows": {"separator": ";", "decimal": ",", "encoding": "cp1252"},
}
# No unit of a quantity is known where nothing states it.
UNKNOWN_UNITS = {
    f"columns.{known}.unit": f'unit = "{LOGGER[known]}"'
    for known in ("motor_torque_Nm", "fy_N", "fz_N", "tx_Nm")
}


@dataclass(frozen=True)
class Variant:
    """A folder, and what comes out: `answers` to the draft's questions by key of the file, and
    `refused`, the cause for which the reader refuses, "" where it reads the true values.
    """

    how: Format
    answers: dict[str, str] = field(default_factory=dict)
    refused: str = ""
    # Quantities in the files that no known name stands for.
    unread: tuple[str, ...] = ()
    # Replaced in the draft, as a user might.
    edits: dict[str, str] = field(default_factory=dict)


def write_as(names, units, signs=(), without=(), **how):
    columns = {}
    for known, name in names.items():
        if known not in without:
            unit = units[known]
            text = name.replace("%", SPELT.get(unit, unit) if "_%" in name else unit)
            columns[known] = Written(text, unit, -1 if known in signs else 1)
    return Format(columns, **how)


def make_variants():
    return {
        **make_dialects(),
        **make_signs(),
        **make_units(),
        **make_kinds(),
        **make_questions(),
        **make_axes(),
        **make_faults(),
    }


def make_dialects():
    """Every way to name columns, in every dialect, in three sets of units."""
    named = {
        **{"brackets": BRACKETS, "german": GERMAN, "slashes": SLASHES},
        **{"camel": CAMEL, "underscores": UNDERSCORES, "words": WORDS},
    }
    sets = {"our units": OURS, "logger's units": LOGGER, "imperial": IMPERIAL}
    # A slash ends at one word, and names do not end in "turn" everywhere.
    others = {
        "slashes": {"shaft_speed_rad_s": "rpm"},
        "underscores": {"shaft_angle_rad": "deg"},
    }
    variants = {}
    for names_id, dialect, units_id in itertools.product(named, TEXT, sets):
        units = {**sets[units_id], **others.get(names_id, {})}
        how = write_as(named[names_id], units, **TEXT[dialect])
        variants[f"{names_id}, {dialect}, {units_id}"] = Variant(how)
    return variants


def make_signs():
    signs = ("fz_N", "fy_N", "tx_Nm", "motor_torque_Nm", "shaft_speed_rad_s", "shaft_angle_rad")
    variants = {"all turned": Variant(write_as(BRACKETS, LOGGER, signs))}
    for known in signs:
        variants[f"{known} turned"] = Variant(write_as(BRACKETS, LOGGER, (known,)))
    return variants


def make_units():
    """Every unit of a quantity, the others in ours."""
    units = {
        "t_s": ("s", "ms", "us", "ns", "min"),
        "shaft_angle_rad": ("rad", "deg", "turn", "\N{DEGREE SIGN}"),
        "shaft_speed_rad_s": ("deg/s", "rpm"),
        "fz_N": ("kN", "mN", "lbf", "kgf"),
        "tx_Nm": ("N m", "N*m", "Nmm", "mNm", "kNm"),
    }
    variants = {}
    for known, of_quantity in units.items():
        for unit in of_quantity:
            variants[f"{known} in {unit}"] = Variant(write_as(BRACKETS, {**OURS, known: unit}))
    return variants


def make_kinds():
    """Units in a row or in attributes, and files of arrays."""
    variants = {}
    for dialect, options in TEXT.items():
        how = write_as(BARE, LOGGER, ("fz_N",), unit_row=True, **options)
        variants[f"row of units, {dialect}"] = Variant(how)
    for kind in ("h5", "tdms"):
        how = write_as(BARE, LOGGER, ("fy_N",), unit_row=True, kind=kind)
        variants[f"{kind} with units"] = Variant(how)
    grouped = write_as(BARE, LOGGER, unit_row=True, kind="h5", group="position log/leg/")
    variants["h5 in groups"] = Variant(grouped)
    # The slash of a unit is no group's.
    for kind, names in (("parquet", SLASHES), ("h5", BRACKETS), ("parquet", WORDS)):
        how = write_as(names, {**OURS, "shaft_speed_rad_s": "deg/s"}, kind=kind)
        variants[f"{kind}, {names['t_s']}"] = Variant(how)
    for kind in ("h5", "mat", "parquet", "feather", "tdms"):
        how = write_as(UNDERSCORES, LOGGER, ("tx_Nm",), kind=kind)
        variants[f"{kind}, units in the names"] = Variant(how)
    return variants


def make_questions():
    """What the draft must ask, because nothing tells it."""
    bare = write_as(BARE, LOGGER)
    amperes = {**write_as(BRACKETS, LOGGER).columns, "motor_torque_Nm": Written("tau [A]", "N")}
    without = {known: name for known, name in BARE.items() if known not in ("fy_N", "tx_Nm")}
    turns = {**LOGGER, "shaft_angle_rad": "turn"}
    turn_asked = {**UNKNOWN_UNITS, "columns.shaft_angle_rad.unit": 'unit = "turn"'}
    two = {**BRACKETS, "motor_torque_Nm": "Fz raw [%]"}
    no_time = {**BRACKETS, "t_s": "x axis [%]"}
    some = {key: text for key, text in UNKNOWN_UNITS.items() if key.split(".")[1] in without}
    return {
        "no unit anywhere": Variant(bare, UNKNOWN_UNITS),
        "no unit anywhere, angle turned": Variant(
            write_as(BARE, LOGGER, ("shaft_angle_rad", "shaft_speed_rad_s")), UNKNOWN_UNITS
        ),
        "no unit anywhere, time in s": Variant(
            write_as(BARE, {**LOGGER, "t_s": "s"}), UNKNOWN_UNITS
        ),
        "no unit anywhere, speed in deg/s": Variant(
            write_as(BARE, {**LOGGER, "shaft_speed_rad_s": "deg/s"}), UNKNOWN_UNITS
        ),
        "no unit anywhere, angle in rad": Variant(
            write_as(BARE, {**LOGGER, "shaft_angle_rad": "rad"}), UNKNOWN_UNITS
        ),
        "turns or rad": Variant(write_as(BARE, turns, without=("shaft_speed_rad_s",)), turn_asked),
        "some quantities only": Variant(write_as(without, LOGGER), some),
        "no force in z": Variant(
            write_as(BRACKETS, LOGGER, without=("fz_N",)),
            {"columns.fz_N.name": ""},
        ),
        "two columns for one": Variant(
            write_as(two, LOGGER | {"motor_torque_Nm": "kN"}),
            {"columns.fz_N.name": 'name = "Fz [kN]"', "columns.fz_N.unit": 'unit = "kN"'},
            unread=("motor_torque_Nm",),
        ),
        "a unit of something else": Variant(
            replace(write_as(BRACKETS, LOGGER), columns=amperes),
            {"columns.motor_torque_Nm.name": ""},
            unread=("motor_torque_Nm",),
        ),
        "no angle": Variant(write_as(BRACKETS, LOGGER, without=("shaft_angle_rad",))),
        "no angle and no speed": Variant(
            write_as(BRACKETS, LOGGER, without=("shaft_angle_rad", "shaft_speed_rad_s"))
        ),
        "time by its slope alone": Variant(write_as(no_time, LOGGER)),
    }


def make_axes():
    """A sensor that is mounted in other axes than its names say here."""
    turned = {**BRACKETS, "fy_N": "Fz [%]", "fz_N": "Fy [%]"}
    right = {
        "columns.fy_N.name": 'name = "Fz [kN]"',
        "columns.fz_N.name": 'name = "Fy [kN]"',
    }
    sideways = {**BRACKETS, "fy_N": "Fx [%]", "fx_N": "Fy [%]"}
    asked = {"columns.fy_N.sign": "sign = 1"}
    edits = {'"Fx [kN]"': '"swap"', '"Fy [kN]"': '"Fx [kN]"', '"swap"': '"Fy [kN]"'}
    return {
        "y and z exchanged": Variant(write_as(turned, LOGGER), right),
        "x and y exchanged": Variant(
            write_as(sideways, {**LOGGER, "fx_N": "kN"}), asked, edits=edits
        ),
    }


def make_faults():
    """What the reader must refuse."""
    bracketed = write_as(BRACKETS, LOGGER)
    row = write_as(BARE, LOGGER, unit_row=True)
    contradicting = {
        **write_as(BRACKETS, LOGGER).columns,
        "fz_N": Written("Fz [N]", "kN"),
    }
    volts = {**write_as(BRACKETS, LOGGER).columns, "fz_N": Written("Fz [V]", "N")}
    return {
        "unit of the name is contradicted": Variant(
            bracketed,
            edits={'name = "Fz [kN]", unit = "kN"': 'name = "Fz [kN]", unit = "N"'},
            refused=r"column Fz \[kN\]: the file states the unit kN, and \[columns\.fz_N\]",
        ),
        "unit of the name is not taken": Variant(
            bracketed,
            edits={'name = "Fz [kN]", unit = "kN"': 'name = "Fz [kN]"'},
            refused=r'fz_N is in N; write unit = "kN" in \[columns\.fz_N\]',
        ),
        "unit of the row is contradicted": Variant(
            row,
            edits={'name = "force_z", unit = "kN"': 'name = "force_z", unit = "N"'},
            refused=r"column force_z: the file states the unit kN, and \[columns\.fz_N\]",
        ),
        "row and name differ": Variant(
            replace(row, columns=contradicting),
            answers={"columns.fz_N.unit": 'unit = "kN"'},
            refused="",
        ),
        "volts": Variant(
            replace(bracketed, columns=volts),
            answers={"columns.fz_N.name": 'name = "Fz [V]"', "columns.fz_N.unit": 'unit = "N"'},
        ),
        "column twice": Variant(
            bracketed,
            edits={'name = "Fy [kN]"': 'name = "Fz [kN]"'},
            refused=r"column Fz \[kN\] is already that of fy_N",
        ),
        "column of another name": Variant(
            bracketed,
            edits={'name = "Fy [kN]"': 'name = "Fy"'},
            refused=r"column Fy, which \[columns\.fy_N\] names, is missing",
        ),
        "no rest": Variant(
            bracketed,
            edits={"repeat = 1": "repeat = 1\nstarts_at_s = -0.05"},
            refused="needs 0.1 s or more before the motion starts",
        ),
    }


VARIANTS = make_variants()


@pytest.fixture(scope="module")
def ours():
    return read_campaign(SMALL)


@pytest.fixture(scope="module")
def usual():
    return read_data(find_shipped("calibration") / "twin.toml")


def ask(path, answers):
    """Answers the questions of the draft at `path`; returns those that it asked."""
    asked = set()
    while True:
        try:
            return read_campaign(path.parent), asked
        except BadInput as error:
            place, _, rest = str(error).partition(": ")
            key = rest.partition(": ")[0]
            if "is still a question mark" not in str(error):
                raise
        assert key in answers, f"asked for {key}: {answers}"
        asked.add(key)
        number = int(place.rpartition(":")[2])
        lines = path.read_text(encoding="utf-8").split("\n")
        leaf = key.rpartition(".")[2]
        lines[number - 1] = lines[number - 1].replace(f'{leaf} = "?"', answers[key])
        if not answers[key]:
            lines[number - 1] = ""
        path.write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize("name", VARIANTS)
def test_a_folder_of_other_peoples_strokes(tmp_path, ours, usual, name):
    variant = VARIANTS[name]
    truths = write_folder(tmp_path / "theirs", ours, variant.how)
    path = write_leg_draft(tmp_path / "theirs", usual).path
    text = path.read_text(encoding="utf-8")
    for old, new in variant.edits.items():
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    if variant.refused:
        with pytest.raises(BadInput, match=variant.refused) as refused:
            ask(path, variant.answers)
        assert "\n" not in str(refused.value)
        return
    theirs, asked = ask(path, variant.answers)
    assert asked == set(variant.answers)
    assert not find_slips(theirs)
    for stroke, truth, original in zip(theirs.strokes, truths, ours.strokes, strict=True):
        condition = (stroke.height_m, stroke.speed_rad_s, stroke.repeat)
        assert condition == (original.height_m, original.speed_rad_s, original.repeat)
        stream = stroke.streams["table"]
        np.testing.assert_allclose(stream.t_s, truth["t_s"], rtol=0, atol=1e-9)
        expected = set(variant.how.columns) - {"t_s"} - set(variant.unread)
        assert expected <= set(stream.columns)
        for known in expected:
            largest = np.abs(truth[known]).max()
            values = stream.columns[known].values
            np.testing.assert_allclose(values, truth[known], rtol=0, atol=1e-9 * largest)


def test_there_are_many_variants():
    assert len(VARIANTS) >= 60

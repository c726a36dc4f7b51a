"""Draft of a rig file: ten answers, usual values of everything else, and beside each key its
meaning and its allowed values.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import find_motor, find_sensor, load_object
from rfca_rig.escaping import toml_comment
from rfca_rig.toml import degrees_key, format_value

COMMENT_COLUMN = 44
WIDTH = 130
USUAL = "usual value: check"
LIMITS = {"exclusiveMinimum": "> ", "minimum": ">= ", "exclusiveMaximum": "< ", "maximum": "<= "}
# The calibrated camera of the twin sees a leg of this length in all its poses, mm.
IN_THE_PICTURE_mm = 330.0
# Of a floor with Coulomb friction only, these keys are absent.
NOT_COULOMB = ("presliding_mm", "tangential_damping_N_s_per_m")


@dataclass(frozen=True)
class RigAnswers:
    """What only the user knows of a rig.

    Parameters
    ----------
    link_lengths_mm, link_masses_g
        (n,) from the shaft outwards.
    below_shaft_mm
        From the shaft's axis down to the sensor's origin.
    force_N, torque_Nm
        Limits of the load on the sensor.
    drive, interface, channel, drive_number
        The make of the drive, one of `devices.list_motors`; its bus, as python-can names it; its
        number on the bus.
    sensor, address
        The make of the force sensor, one of `devices.list_sensors`, and its host, port or
        calibration file.
    counts
        Counts per N and per N m, where the sensor itself stated them.
    """

    link_lengths_mm: tuple[float, ...]
    link_masses_g: tuple[float, ...]
    below_shaft_mm: float
    force_N: float
    torque_Nm: float
    drive: str
    interface: str
    channel: str
    drive_number: int
    sensor: str
    address: str
    counts: tuple[float, float] | None = None


def draft_rig(title: str, answers: RigAnswers, usual: Mapping[str, Any]) -> str:
    """The text of a rig file of kind "twin".

    Parameters
    ----------
    title
        Name of the rig, as on reports.
    answers
        What was asked.
    usual
        The tables of the shipped twin, from which all other values come.
    """
    make = find_motor(answers.drive)
    sensor_make = find_sensor(answers.sensor)
    number_key, _ = make.number
    address_key, *_ = sensor_make.address
    # A make that the shipped twin does not have takes nothing of it.
    motor_values, sensor_values = (
        usual[section] if usual[section]["device"] == device else values
        for section, device, values in (
            ("motor", answers.drive, make.usual),
            ("force_sensor", answers.sensor, sensor_make.usual),
        )
    )
    asked: dict[str, dict[str, Any]] = {
        "rig": {"title": title, "kind": "twin"},
        "leg": {
            "link_lengths_mm": list(answers.link_lengths_mm),
            "link_masses_g": list(answers.link_masses_g),
            "hinge_torque_Nm": usual["leg"]["hinge_torque_Nm"],
        },
        "ground": {},
        "sensor": {"below_shaft_mm": answers.below_shaft_mm},
        "drive": {"mode": usual["drive"]["mode"]},
        "known_to": {},
        "limits": {"force_N": answers.force_N, "torque_Nm": answers.torque_Nm},
        "motor": {
            "device": answers.drive,
            number_key: answers.drive_number,
            "interface": answers.interface,
            "channel": answers.channel,
        },
        "force_sensor": {"device": answers.sensor, address_key: answers.address},
        "twin": dict(usual["twin"]),
    }
    if answers.counts is not None and "counts_per_N" in sensor_values:
        asked["force_sensor"].update(
            zip(("counts_per_N", "counts_per_Nm"), answers.counts, strict=True)
        )
    others: dict[str, Mapping[str, Any]] = {
        **usual,
        "ground": {key: value for key, value in usual["ground"].items() if key not in NOT_COULOMB},
        "motor": {"direction": usual["motor"]["direction"], **motor_values},
        "force_sensor": sensor_values,
        "twin": {},
    }
    if sum(answers.link_lengths_mm) <= IN_THE_PICTURE_mm:
        # The twin's camera is complete: nothing of it needs a check.
        asked["camera"] = dict(usual["camera"])
    else:
        asked["twin"].pop("camera", None)
    schema = RigFile.model_json_schema()
    for table, kind, section_name in (
        ("motor", answers.drive, make.section),
        ("force_sensor", answers.sensor, sensor_make.section),
    ):
        makes: dict[str, str] = schema["properties"][table]["discriminator"]["mapping"]
        if kind not in makes:
            # The schema of the file has the built-in kinds only.
            section = load_object(section_name)
            schema["$defs"][section.__name__] = section.model_json_schema()
            makes[kind] = f"#/$defs/{section.__name__}"
    lines = [
        toml_comment(
            f"Rig file of {title}. A line that ends in '{USUAL}' holds a value of the "
            "paper's leg or of a usual device."
        ),
        toml_comment(
            "Replace it by what you weigh, measure or read off. Then set kind to real, "
            "and run rfca-rig doctor with this file."
        ),
    ]
    for name, values in asked.items():
        lines += [
            "\n",
            *lines_of_table(
                name,
                schema["properties"][name],
                schema["$defs"],
                values,
                {**others[name], **values},
            ),
        ]
    return "".join(lines)


def lines_of_table(
    name: str,
    schema: Mapping[str, Any],
    known: Mapping[str, Any],
    asked: Mapping[str, Any],
    values: Mapping[str, Any],
    guessed: Mapping[str, str] | None = None,
) -> Iterator[str]:
    """The lines of one table: its meaning, its keys in the order of the schema, and the tables
    in it. `guessed` says of a key how its value was guessed.
    """
    guessed = guessed or {}
    # A table that may be absent is the one choice beside null.
    schema = next(
        (choice for choice in schema.get("anyOf", ()) if choice.get("type") != "null"), schema
    )
    makes: dict[str, str] = schema.get("discriminator", {}).get("mapping", {})
    table = known[(makes[values["device"]] if makes else schema["$ref"]).rpartition("/")[2]]
    # The first paragraph, without the name of the table, which follows.
    meaning = " ".join(table.get("description", "").partition("\n\n")[0].split()).removeprefix(
        f"[{name}]: "
    )
    for line in wrap(meaning[:1].upper() + meaning[1:], WIDTH):
        yield toml_comment(line)
    yield f"[{name}]\n"
    inner: list[tuple[str, Any]] = []
    # The make of a device decides which other keys there are, so it comes first.
    for key, value_schema in sorted(
        table["properties"].items(), key=lambda item: item[0] != "device"
    ):
        written, value = _in_degrees(key, values, table["properties"])
        if isinstance(value, Mapping):
            inner.append((key, value_schema))
        elif value is not None:
            described = dict(value_schema)
            if key == "device":
                described["enum"] = [*makes]
            if written != key:
                # Limits of an angle in degrees.
                described |= {
                    limit: round(math.degrees(schema_value))
                    for limit, schema_value in described.items()
                    if limit in LIMITS
                }
            notes = []
            if key not in asked:
                notes = [guessed.get(key, USUAL)]
            yield _line(f"{written} = {format_value(value)}", described, notes)
        elif "default" in value_schema and not _holds_table(value_schema):
            default = value_schema["default"]
            yield _line(
                f"# {key} ={'' if default is None else f' {format_value(default)}'}",
                value_schema,
                ["optional"],
            )
    for key, value_schema in inner:
        yield "\n"
        yield from lines_of_table(
            f"{name}.{key}", value_schema, known, asked.get(key, {}), values[key]
        )


def _in_degrees(
    key: str, values: Mapping[str, Any], properties: Mapping[str, Any]
) -> tuple[str, Any]:
    """Name and value of a key; an angle in radians is written in degrees."""
    twin = degrees_key(key)
    if twin is None or twin not in properties:
        # The same angle in degrees has its own place in the schema, beside that in radians.
        if any(degrees_key(other) == key for other in properties):
            return key, None
        return key, values.get(key)
    if twin not in values and key in values:
        return twin, round(math.degrees(values[key]), 2)
    return twin, values.get(twin)


def _holds_table(schema: Mapping[str, Any]) -> bool:
    choices = [schema, *schema.get("anyOf", ()), *schema.get("oneOf", ()), schema.get("items", {})]
    return (
        any("$ref" in choice or "discriminator" in choice for choice in choices)
        or schema.get("type") == "object"
    )


def _line(start: str, schema: Mapping[str, Any], notes: list[str]) -> str:
    pieces = [schema.get("description", ""), ", ".join(list_limits(schema)), *notes]
    text = "; ".join(piece for piece in pieces if piece)
    if text:
        return f"{start:<{COMMENT_COLUMN - 1}} {toml_comment(text)}"
    return f"{start}\n"


def list_limits(schema: Mapping[str, Any]) -> list[str]:
    """What a JSON schema allows for a value, as texts: words in quotes, and limits of numbers
    and of lists.
    """
    limits: list[str] = []
    for choice in schema.get("anyOf", [schema]):
        if "const" in choice or "enum" in choice:
            limits += [json.dumps(value) for value in choice.get("enum", [choice.get("const")])]
        limits += [f"{sign}{choice[key]:g}" for key, sign in LIMITS.items() if key in choice]
        if choice.get("type") == "boolean":
            limits.append("true, false")
        if choice.get("type") == "array":
            limits += [f"each {limit}" for limit in list_limits(choice.get("items", {}))]
            limits += [
                f"{choice[key]} or {word}"
                for key, word in (("minItems", "more"), ("maxItems", "fewer"))
                if key in choice
            ]
    return limits

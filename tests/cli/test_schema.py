"""`schema`: the printed JSON schemas take every file that came with the package, and refuse what
the reader refuses.
"""

import json
import tomllib
from pathlib import Path

import pytest

from tests.cli.typed import typed

ROOT = Path(__file__).parents[2]
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}
SHIPPED = {
    "rig": [
        ROOT / f"{name}.toml"
        for name in (
            "calibration/twin",
            "calibration/twin-daq",
            "tests/data/real-rig",
            "docs/examples/our-rig",
        )
    ],
    "protocol": sorted((ROOT / "protocols").glob("*.toml")),
    "sweep": sorted((ROOT / "sweeps").glob("*.toml")),
    "campaign": [ROOT / "tests/data/small-campaign/campaign.toml"],
}


def fits(data, schema, root) -> bool:
    """Whether data fit a schema, of the keywords that these schemas use; others are refused."""
    checks = {
        "$ref": lambda ref: fits(data, root["$defs"][ref.rpartition("/")[2]], root),
        "type": lambda name: (
            isinstance(data, TYPES[name]) and (name == "boolean" or not isinstance(data, bool))
        ),
        "const": lambda value: data == value,
        "enum": lambda values: data in values,
        "anyOf": lambda parts: any(fits(data, part, root) for part in parts),
        "oneOf": lambda parts: sum(fits(data, part, root) for part in parts) == 1,
        "allOf": lambda parts: all(fits(data, part, root) for part in parts),
        "not": lambda part: not fits(data, part, root),
        "required": lambda keys: all(key in data for key in keys),
        "properties": lambda known: (
            not isinstance(data, dict)
            or all(fits(data[key], known[key], root) for key in known if key in data)
        ),
        "additionalProperties": lambda rest: all(
            rest is True or (rest is not False and fits(data[key], rest, root))
            for key in data
            if key not in schema.get("properties", ())
        ),
        "items": lambda part: (
            not isinstance(data, list) or all(fits(each, part, root) for each in data)
        ),
        "prefixItems": lambda parts: all(
            fits(each, part, root) for each, part in zip(data, parts, strict=False)
        ),
        "minItems": lambda least: len(data) >= least,
        "maxItems": lambda most: len(data) <= most,
        "minLength": lambda least: len(data) >= least,
        "maxLength": lambda most: len(data) <= most,
        "minimum": lambda least: data >= least,
        "maximum": lambda most: data <= most,
        "exclusiveMinimum": lambda bound: data > bound,
        "exclusiveMaximum": lambda bound: data < bound,
        "propertyNames": lambda part: all(fits(key, part, root) for key in data),
    }
    words = {"title", "description", "default", "discriminator", "$schema", "$defs"}
    # The type comes first: limits have a meaning only for it.
    order = sorted(set(schema) - words, key=lambda key: key not in ("type", "$ref"))
    return all(checks[key](schema[key]) for key in order)


@pytest.fixture
def schema_of(monkeypatch, capsys):
    def read(kind: str):
        said = typed(monkeypatch, capsys, "schema", kind)
        assert said.exit_code == 0
        return json.loads(said.out)

    return read


@pytest.mark.parametrize(
    ("kind", "file"), [(kind, file) for kind, files in SHIPPED.items() for file in files], ids=str
)
def test_every_file_of_the_package_fits_its_schema(schema_of, kind, file):
    schema = schema_of(kind)
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert fits(tomllib.loads(file.read_text(encoding="utf-8")), schema, schema)


EXPERIMENT = {
    "format": "rfca-experiment/1",
    "title": "an arm",
    "model": "arm.xml",
    "time": {"column": "t", "unit": "s"},
    "signals": [{"joint": "a", "quantity": "position", "column": "q", "unit": "deg"}],
    "recordings": [{"file": "one.csv", "condition": "slow"}],
}


@pytest.mark.parametrize(
    ("changes", "takes"),
    [
        ({}, True),
        ({"known_to": {"zero_offset_deg": 0.3}}, True),
        ({"known_to": {"zero_offset_deg": 0.3, "zero_offset_rad": 0.005}}, False),
        ({"known_to": {"zero_offset": 0.3}}, False),
        ({"recordings": []}, False),
        ({"title": 3}, False),
    ],
)
def test_a_schema_takes_and_refuses_as_the_reader_does(schema_of, changes, takes):
    schema = schema_of("experiment")
    assert fits({**EXPERIMENT, **changes}, schema, schema) is takes


def test_the_leg_takes_its_start_angle_in_either_unit_and_a_law_or_a_curve(schema_of):
    schema = schema_of("rig")
    rig = tomllib.loads(SHIPPED["rig"][0].read_text(encoding="utf-8"))
    leg = rig["leg"]
    without = {key: value for key, value in leg.items() if key != "start_angle_rad"}
    no_law = {
        key: value
        for key, value in leg.items()
        if key not in ("hinge_torque_Nm", "k0_Nm_per_rad", "k2_per_rad2")
    }
    curve = {"torque_rotation": {"curve": "curve.csv"}}
    for changed, takes in (
        ({**without, "start_angle_deg": 14.1}, True),
        ({**leg, "start_angle_deg": 14.1}, False),
        (without, False),
        (no_law, False),
        ({**no_law, **curve}, True),
        ({**leg, **curve}, False),
    ):
        assert fits({**rig, "leg": changed}, schema, schema) is takes


def test_an_unknown_kind_of_file_is_one_line_with_those_that_there_are(monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "schema", "rgi")
    assert (said.exit_code, said.out) == (2, "")
    assert len(said.err.splitlines()) == 1
    assert "rig" in said.err and "campaign" in said.err

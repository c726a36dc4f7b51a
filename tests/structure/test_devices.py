"""A make of a device is a folder: nothing else in the package names it, and no folder uses
another.
"""

import re
from pathlib import Path

import pytest

from rfca_rig.devices import FORCE_SENSORS, MOTORS, OWN
from tests.structure.tree import find_imports, read_modules

PACKAGE = Path(__file__).parents[2] / "rfca_rig"
DEVICES = PACKAGE / "devices"
FOLDERS = sorted(folder.name for folder in DEVICES.iterdir() if (folder / "__init__.py").exists())
PARTS = {"section", "codec", "driver", "twin", "checks"}
# The tables of the built-in kinds.
REGISTRY = DEVICES / "__init__.py"
PLACES = [
    place for table in (MOTORS, FORCE_SENSORS) for kind, place in table.items() if kind != OWN
]


def test_every_folder_is_in_the_registry():
    assert {place.split(".")[2].partition(":")[0] for place in PLACES} == {*FOLDERS}


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_make_has_its_parts_in_its_folder(folder):
    assert {path.stem for path in (DEVICES / folder).iterdir()} >= PARTS


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_make_is_named_in_its_folder_and_in_the_registry_only(folder):
    elsewhere = [
        f"{path.relative_to(PACKAGE)}:{number}: {line.strip()}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if DEVICES / folder not in path.parents and path != REGISTRY
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if re.search(folder, line, re.IGNORECASE)
    ]
    assert elsewhere == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_registry_names_a_make_in_one_line_for_each_kind(folder):
    lines = [
        line for line in REGISTRY.read_text().splitlines() if re.search(folder, line, re.IGNORECASE)
    ]
    assert len(lines) == sum(place.startswith(f"rfca_rig.devices.{folder}:") for place in PLACES)


@pytest.mark.parametrize(
    ("page", "kind"),
    [
        *(("add-a-motor.md", kind) for kind in MOTORS),
        *(("force-sensors.md", kind) for kind in FORCE_SENSORS if kind != OWN),
    ],
)
def test_every_kind_stands_on_its_page(page, kind):
    assert re.search(rf'[`"]{kind}[`"]', (PACKAGE.parent / "docs" / page).read_text())


def test_no_folder_uses_another():
    # A module that imports one of them names this package; to parse all others would take most of
    # the time.
    modules = {
        name: module
        for name, module in read_modules().items()
        if DEVICES in module.path.parents or DEVICES.name in module.text or name == PACKAGE.name
    }
    imports = find_imports(modules)
    assert len(modules) > len([*DEVICES.rglob("*.py")]) > 30
    for folder in FOLDERS:
        inside = f"rfca_rig.devices.{folder}"
        for name, imported in imports.items():
            users = [
                other for other in imported if other == inside or other.startswith(f"{inside}.")
            ]
            assert not users or name == inside or name.startswith(f"{inside}."), (
                f"{name} imports {users}"
            )

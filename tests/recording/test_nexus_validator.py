"""Recordings are checked by a validator of NeXus that other people wrote, nexusformat's `nxcheck`.

It brings the definitions of NeXus and needs no network.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import h5py
import pytest

import rfca_rig as rr
from rfca_rig.recording import run_folder
from rfca_rig.recording.layout import stage_files
from tests.recording.growing import grown

pytest.importorskip("nexusformat", reason="comes with the extra comparison")

# What a recording holds beside the terms of NeXus. A group may hold more than the terms of its
# class, unless their definition has the attribute `restricts` (nxdl.xsd, definitionType); these
# have not, which is tested below. So nxcheck warns of the additions, and calls them no errors.
OWN_TERMS = {
    "NXroot": {"@format", "@sealed", "@source", "@title", "believed", "known_to", "provenance"},
    "NXsubentry": {
        "@cut_short",
        "@height_mm",
        "@label",
        "@order",
        "@repeat",
        "@speed_rad_s",
    },
}
# Lines of nxcheck: where it is, and what it reports there.
PLACE = re.compile(r"(NX\w+|Field|Group|Link): (\S+)")
OWN_TERM = re.compile(r'"(@\w+)" is not defined as an attribute in (\w+)')
OWN_FIELD = re.compile(r"This field is not defined in (\w+)")
INVALID_NAME = re.compile(r'"(.*)" is an invalid name')
HEADER = ("Filename:", "Path:", "Definitions:", "Total number of")
COLOUR = re.compile(r"\x1b\[[\d;]*m")


def definition(name: str) -> ElementTree.Element:
    """A definition of NeXus that nexusformat brings."""
    folder = Path(find_spec("nexusformat").origin).parent / "definitions"
    return ElementTree.parse(folder / name).getroot()


def is_valid_name(name: str) -> bool:
    """Whether the definitions allow the name for a group or a field."""
    schema = {"xs": "http://www.w3.org/2001/XMLSchema"}
    pattern = definition("nxdl.xsd").find(
        "xs:simpleType[@name='validItemName']/xs:restriction/xs:pattern", schema
    )
    return re.fullmatch(pattern.get("value"), name) is not None


def check(path: Path, copy: Path) -> list[tuple[str, str]]:
    """Where nxcheck reports what, as pairs; a copy is checked, since it opens files for writing."""
    shutil.copyfile(path, copy)
    command = [sys.executable, "-m", "nexusformat.scripts.nxcheck", str(copy)]
    result = subprocess.run(command, capture_output=True, encoding="utf-8", check=True, timeout=60)
    lines = [line.strip() for line in COLOUR.sub("", result.stdout).splitlines()]
    # Without it the validator did not come to its end.
    assert any(line.startswith("Total number of errors:") for line in lines), result.stderr
    place = ""
    reports = []
    for line in lines:
        if PLACE.fullmatch(line):
            place = PLACE.fullmatch(line)[2]
        elif line and not line.startswith(HEADER):
            reports.append((place, line))
    return reports


def is_allowed(place: str, report: str) -> bool:
    """Whether a report of nxcheck is about something that NeXus allows."""
    if named := OWN_TERM.fullmatch(report):
        return named[1] in OWN_TERMS.get(named[2], ())
    if named := OWN_FIELD.fullmatch(report):
        return place.removeprefix("/") in OWN_TERMS.get(named[1], ())
    # Stages are numbered: `001`. NeXus allows a digit in front since November 2020
    # (nexusformat/definitions#671; validItemName in nxdl.xsd, "Naming Conventions" in the manual).
    # nexusformat 2.1.0 brings these definitions, but its code has the older rule; 2.0.0 has not.
    if named := INVALID_NAME.fullmatch(report):
        return named[1][:1].isdigit() and is_valid_name(named[1])
    return False


def objections(path: Path, copy: Path) -> list[tuple[str, str]]:
    return [report for report in check(path, copy) if not is_allowed(*report)]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """run.h5 of a run, one that has raw and static stages too, and a stage on its own."""
    below = tmp_path_factory.mktemp("nexus")
    done = rr.run(height_mm=215, speed_rad_s=2.433, repeats=1, seed=3, runs=below / "runs")
    folder = below / "grown"
    grown(folder, 2).finish("done")
    return {
        "run.h5": done.path / "run.h5",
        "raw and static": run_folder.build_recording(folder),
        "a stage": stage_files(folder)[0],
    }


@pytest.mark.parametrize("name", ["run.h5", "raw and static", "a stage"])
def test_the_validator_has_no_objection(files: dict[str, Path], name: str, tmp_path: Path):
    assert objections(files[name], tmp_path / "copy.h5") == []


def _set(group: str, attribute: str, value: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        file[group].attrs[attribute] = value

    return change


def _delete(group: str, attribute: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[group].attrs[attribute]

    return change


FORCE = "strokes/001/force"
FAULTS = {
    "an unknown class": (_set(FORCE, "NX_class", "NXstream"), "NXstream is not a valid base class"),
    "no class": (_delete(FORCE, "NX_class"), "This group has no NeXus base class assigned"),
    "no signal": (_delete(FORCE, "signal"), '"@signal" is not present in the group'),
    "a signal elsewhere": (_set(FORCE, "signal", "fz"), 'Signal "fz" is not present in the group'),
    "an axis elsewhere": (_set(FORCE, "axes", "t"), 'Axis "t" is not present in the group'),
    "no axes": (_delete(FORCE, "axes"), '"@axes" is not present in the group'),
    "a name with a hyphen": (
        lambda file: file.move("strokes/001", "strokes/1-a"),
        '"1-a" is an invalid name',
    ),
    "another attribute": (
        _set("strokes/001", "height_m", "0.215"),
        '"@height_m" is not defined as an attribute in NXsubentry',
    ),
    "another field": (
        lambda file: file.create_dataset("remarks", data="none"),
        "This field is not defined in NXroot",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_an_objection(files: dict[str, Path], fault: str, tmp_path: Path):
    faulty = tmp_path / "faulty.h5"
    shutil.copyfile(files["raw and static"], faulty)
    make_fault, expected = FAULTS[fault]
    with h5py.File(faulty, "r+") as file:
        make_fault(file)
    reports = objections(faulty, tmp_path / "copy.h5")
    assert expected in [report for _, report in reports]


@pytest.mark.parametrize("base_class", OWN_TERMS)
def test_the_definitions_allow_terms_of_our_own(base_class: str):
    assert "restricts" not in definition(f"base_classes/{base_class}.nxdl.xml").attrib
    names = [name.removeprefix("@") for name in OWN_TERMS[base_class]]
    assert [name for name in names if not is_valid_name(name)] == []

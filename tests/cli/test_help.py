"""The help of every command: groups, units, closed sets, an example that the command takes, and
nothing of Python.
"""

import re
import subprocess
import sys

import pytest
import typer

from rfca_rig import __version__
from rfca_rig.bench.fault_injection import faults_of_served_rig
from rfca_rig.cli import commands, names
from rfca_rig.cli.main import app
from rfca_rig.cli.options import GROUPS
from rfca_rig.description.rig_file import read_rig
from rfca_rig.exam.cases import KINDS
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from tests.cli.test_eighty_columns import ROOT, every_command
from tests.cli.typed import typed

PROGRAM = typer.main.get_command(app)
# Once: it makes all commands again, and every worker imports this file.
PATHS = list(every_command())


def has_commands(path):
    return any(other[: len(path)] == path for other in PATHS if other != path)


LEAVES = [path for path in PATHS if path and not has_commands(path)]
# Types of Python, in brackets, and units in words: a unit stands in capitals behind the option's
# name.
TYPES = re.compile(r"<[a-z]")
UNITS_IN_WORDS = re.compile(
    r",? in (mm|degrees|rad/s|rad|pixels|%|seconds|ms|s|N)\b|, mm\b|How many (ms|mm|s) "
)
# The line is whole: what follows it is empty.
EXAMPLE = re.compile(r"^  Example: rfca-rig (.*)\n\n", re.MULTILINE)


def leaf(path):
    command = PROGRAM
    for name in path:
        command = command.commands[name]
    return command


def help_of(monkeypatch, capsys, *path):
    monkeypatch.setenv("COLUMNS", "80")
    said = typed(monkeypatch, capsys, *path, "--help")
    assert said.exit_code == 0
    return said.out


def test_every_command_stands_in_one_group_of_the_help(monkeypatch, capsys):
    grouped = [name for group in GROUPS.values() for name in group]
    assert sorted(grouped) == sorted(PROGRAM.commands)
    text = help_of(monkeypatch, capsys)
    headings = re.findall(r"^(\w[\w ]*):$", text, re.MULTILINE)
    assert headings == ["Options", *GROUPS]
    for title, members in GROUPS.items():
        section = text.partition(f"\n{title}:\n")[2].partition("\n\n")[0]
        assert re.findall(r"^  ([a-z]+)  ", section, re.MULTILINE) == list(members)


@pytest.mark.parametrize("path", LEAVES, ids=" ".join)
def test_every_command_stands_in_a_module_of_its_name_or_where_its_package_says(path):
    package, _, module = leaf(path).callback.__module__.rpartition(".")
    folder = ""
    if path[0] in GROUPS["Measure"]:
        folder = ".measure"
    elif path[0] == "setup":
        folder = ".setup"
    assert package == f"rfca_rig.cli.commands{folder}"
    assert module in (
        path[0],
        path[-1],
        "_".join(path),
    ) or f"`{path[0]}` in `{module}`" in " ".join(commands.__doc__.split())


@pytest.mark.slow
@pytest.mark.parametrize("path", list(every_command()), ids=" ".join)
def test_no_help_names_a_type_of_python_or_a_unit_in_words(monkeypatch, capsys, path):
    text = help_of(monkeypatch, capsys, *path)
    assert not TYPES.search(text)
    assert not UNITS_IN_WORDS.search(" ".join(text.split()))
    assert not re.search(r"[{}]|\[\[", text)


@pytest.mark.parametrize("path", LEAVES, ids=" ".join)
def test_every_command_has_an_example_on_one_line_that_it_takes(monkeypatch, capsys, path):
    (example,) = EXAMPLE.findall(help_of(monkeypatch, capsys, *path))
    words = example.partition(" > ")[0].split()
    assert tuple(words[: len(path)]) == path
    # Parses the words, with their types and limits, and runs nothing.
    leaf(path).make_context("rfca-rig", words[len(path) :])


def test_the_extra_that_mcap_needs_is_named_with_its_brackets(monkeypatch, capsys):
    assert 'pip install "rfca-rig[mcap]"' in " ".join(
        help_of(monkeypatch, capsys, "export", "mcap").split()
    )


def test_the_runs_of_the_doctor_are_not_the_runs_of_a_run(monkeypatch, capsys):
    doctor, run = (
        " ".join(help_of(monkeypatch, capsys, *path).split())
        for path in (("doctor",), ("static", "run"))
    )
    assert "--runs DIR Folder of the runs, whose disk is measured" in doctor
    assert "--runs DIR Folder that receives the new run folder" in run


def test_closed_sets_stand_in_the_help(monkeypatch, capsys):
    kinds = " ".join(help_of(monkeypatch, capsys, "prove").split())
    assert set(names.CASE_KINDS) == set(KINDS)
    assert "; ".join(names.CASE_KINDS) in kinds
    assert ", ".join(names.FIT_PARAMETERS) in " ".join(help_of(monkeypatch, capsys, "fit").split())
    assert ", ".join(names.FILE_KINDS) in " ".join(help_of(monkeypatch, capsys, "schema").split())


def test_lists_hold_every_name_that_the_commands_take(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    effects = typed(monkeypatch, capsys, "diagnose", "--list").out
    effects, _, changes = effects.partition("\n\nOf a leg beside a reference")
    of_leg, _, of_mechanisms = effects.partition("\n\nOf mechanisms and pendulums")
    assert re.findall(r"^(\S+)", of_leg, re.MULTILINE) == sorted(catalogue())
    _, *lines = of_mechanisms.splitlines()
    listed = re.findall(r"^(\S+)", "\n".join(lines), re.MULTILINE)
    assert listed == sorted(names.mechanism_effect_names())
    _, *lines = changes.splitlines()
    listed = re.findall(r"^(\S+)", "\n".join(lines), re.MULTILINE)
    assert listed == sorted(VALUE_OF_CHANGE)
    files = typed(monkeypatch, capsys, "plan", "--list").out
    assert set(re.findall(r"^  (\S+)", files, re.MULTILINE)) == {
        *names.file_names("protocols"),
        *names.rig_names(),
    }
    faults = typed(monkeypatch, capsys, "twin", "serve", "--list").out
    known = [one.name for one in faults_of_served_rig(read_rig(ROOT / "calibration" / "twin.toml"))]
    assert re.findall(r"^(\S+)", faults, re.MULTILINE) == known
    sweeps = typed(monkeypatch, capsys, "sweep", "--list").out
    assert set(names.file_names("sweeps")) <= set(re.findall(r"[\w-]+", sweeps.splitlines()[0]))


def test_a_broken_protocol_hides_no_other_in_the_list(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "protocols").mkdir()
    (tmp_path / "protocols" / "broken.toml").write_text("= 3")
    (tmp_path / "protocols" / "odd.toml").write_text(
        'rig = "x"\nexperiment = [1]\ntitle = "a\\u001b[31mred\\nline"'
    )
    said = typed(monkeypatch, capsys, "plan", "--list")
    assert said.exit_code == 0
    assert "protocols/broken.toml:1: not TOML" in said.out
    assert re.search("^  table2 .*Table II$", said.out, re.MULTILINE)
    (odd,) = (line for line in said.out.splitlines() if line.startswith("  odd "))
    assert odd.endswith("line") and odd.isprintable()


def test_the_module_is_the_command_and_calls_itself_by_its_name():
    version, usage = (
        subprocess.run(
            [sys.executable, "-m", "rfca_rig", option], capture_output=True, text=True, check=True
        ).stdout
        for option in ("--version", "--help")
    )
    assert version == f"rfca-rig {__version__}\n"
    assert usage.startswith("Usage: rfca-rig [OPTIONS] COMMAND")

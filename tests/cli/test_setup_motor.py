"""rfca-rig setup motor: exit codes, the question before it writes, the table, and the lines."""

import io
import re
import sys
from contextlib import nullcontext

import pytest
import typer

from rfca_rig.cli.commands.setup.motor import _conclude
from rfca_rig.cli.terminal import WIDTH
from rfca_rig.devices.drive_setup import Setting
from tests.cli.typed import typed
from tests.engine.rigs import ROOT

ENDPOINTS = ROOT / "calibration" / "twin-endpoints.json"
WITH_ENDPOINTS = ("--endpoints", ENDPOINTS)


class Terminal(io.StringIO):
    """A person at the keyboard."""

    def isatty(self):
        return True


@pytest.fixture
def setup(monkeypatch, capsys):
    def run(*words, rig="twin"):
        return typed(monkeypatch, capsys, "setup", "motor", "--rig", rig, *words)

    return run


def states(out: str) -> dict[str, str]:
    """State by the name of a setting."""
    rows = re.findall(r"^(right|wrong|any|not told) +([a-z]\S*\.\S+) ", out, re.MULTILINE)
    return {name: state for state, name in rows}


def test_wrong_settings_are_told_with_what_to_type_next(setup):
    said = setup(*WITH_ENDPOINTS)
    assert said.exit_code == 1
    found = states(said.out)
    assert found["axis0.config.enable_watchdog"] == "wrong"
    assert found["axis0.config.can.heartbeat_msg_rate_ms"] == "right"
    assert found["axis0.config.motor.current_soft_max"] == "any"
    assert "\n6 right, 8 wrong, 0 not told\n" in said.out
    assert said.err.endswith(f"rfca-rig setup motor --rig twin --endpoints {ENDPOINTS} --write\n")
    assert max(map(len, said.out.splitlines())) <= WIDTH


def test_what_can_is_silent_about_is_not_told_and_is_neither_right_nor_wrong(setup):
    said = setup()
    assert states(said.out)["axis0.config.enable_watchdog"] == "not told"
    assert "\n3 right, 3 wrong, 8 not told\n" in said.out
    assert "flat_endpoints.json" in said.out
    assert said.err == ("lines for the maker's own tool: rfca-rig setup motor --rig twin --print\n")


def test_with_write_all_is_right_afterwards(setup):
    said = setup(*WITH_ENDPOINTS, "--write", "--yes")
    assert said.exit_code == 0
    assert "  axis0.config.enable_watchdog: off -> on\n" in said.out
    assert said.out.endswith("14 right, 0 wrong, 0 not told\n")
    assert said.err == "next: rfca-rig doctor --rig twin\n"


def test_without_a_terminal_it_does_not_write_unasked(setup, monkeypatch):
    for stdin in (None, io.StringIO("y\n")):
        monkeypatch.setattr(sys, "stdin", stdin)
        said = setup(*WITH_ENDPOINTS, "--write")
        assert said.exit_code == 2
        assert said.out == ""
        assert said.err.count("\n") == 1 and "add --yes" in " ".join(said.err.split())


@pytest.mark.parametrize(("answer", "exit_code"), [("y", 0), ("n", 130)])
def test_it_asks_once_before_it_writes(setup, monkeypatch, answer, exit_code):
    monkeypatch.setattr(sys, "stdin", Terminal(f"{answer}\n"))
    said = setup(*WITH_ENDPOINTS, "--write")
    assert said.exit_code == exit_code
    assert said.out.count("write and save 8 settings? [y/N]") == 1
    assert ("written, saved and read back" in said.out) is (answer == "y")


def test_the_lines_are_complete_and_no_bus_is_opened(setup, tmp_path):
    text = (ROOT / "calibration" / "twin.toml").read_text().partition("[camera]")[0]
    text = text.replace('kind = "twin"', 'kind = "real"')
    file = tmp_path / "real.toml"
    file.write_text(text.replace("[motor]\n", '[motor]\nchannel = "nowhere7"\n'))
    assert setup(rig=file).exit_code == 1  # there is no such bus
    said = setup("--print", rig=file)
    assert said.exit_code == 0
    *lines, last = said.out.splitlines()
    assert last == "odrv0.save_configuration()"
    assert "odrv0.axis0.config.enable_watchdog = True" in lines
    assert lines.index("odrv0.axis0.config.watchdog_timeout = 0.1") < lines.index(
        "odrv0.axis0.config.enable_watchdog = True"
    )
    assert "odrv0.can.config.baud_rate = 1000000" in lines
    assert all(line.startswith("odrv0.") for line in lines)
    assert said.err == ""


def test_a_bus_that_does_not_open_is_one_line(setup, tmp_path):
    text = (ROOT / "calibration" / "twin.toml").read_text().partition("[camera]")[0]
    file = tmp_path / "real.toml"
    file.write_text(
        text.replace('kind = "twin"', 'kind = "real"').replace(
            "[motor]\n", '[motor]\nchannel = "nowhere7"\n'
        )
    )
    said = setup(rig=file)
    assert (said.exit_code, said.out) == (1, "")
    assert "CAN bus socketcan nowhere7 cannot be opened" in " ".join(said.err.split())


def test_a_make_without_known_settings_is_refused(setup):
    said = setup(rig=ROOT / "docs" / "examples" / "our-rig.toml")
    assert said.exit_code == 2
    assert "the settings of a our_motor.py are not known here" in " ".join(said.err.split())


@pytest.mark.parametrize(
    ("actual", "can_write", "exit_code", "said"),
    [
        (1.0, True, 0, "next: rfca-rig doctor --rig RIG\n"),
        (2.0, True, 1, "next: COMMAND --write\n"),
        (2.0, False, 1, "lines for the maker's own tool: COMMAND --print\n"),
        (
            None,
            False,
            0,
            "lines for the maker's own tool: COMMAND --print\nnext: rfca-rig doctor --rig RIG\n",
        ),
    ],
)
def test_the_last_line_is_what_to_type_next(capsys, actual, can_write, exit_code, said):
    setting = Setting("name", "purpose", 1.0, actual, can_write=can_write)
    with pytest.raises(typer.Exit) if exit_code else nullcontext():
        _conclude("COMMAND", "RIG", [setting], write=False)
    assert capsys.readouterr().err == said


def test_a_moteus_is_written_over_its_own_stream(setup, tmp_path):
    head, _, rest = (ROOT / "calibration" / "twin.toml").read_text().partition("[motor]\n")
    moteus = 'device = "moteus"\ndirection = 1\ndrive_id = 3\nzero_turns = 0.0\n\n'
    path = tmp_path / "rig.toml"
    path.write_text(f"{head}[motor]\n{moteus}{rest[rest.index('[force_sensor]') :]}")
    said = setup("--write", "--yes", rig=path)
    assert said.exit_code == 0
    _, _, changes = said.out.partition("written, saved and read back:\n")
    assert changes == (
        "  id.id: 1 -> 3\n"
        "  servopos.position_min: -0.01 rev -> none\n"
        "  servopos.position_max: 0.01 rev -> none\n"
        "6 right, 0 wrong, 0 not told\n"
    )
    printed = setup("--print", rig=path).out.splitlines()
    assert printed[0] == "python -m moteus_gui.tview --target 1"
    assert printed[-2:] == ["python -m moteus_gui.tview --target 3", "conf write"]
    refused = setup(*WITH_ENDPOINTS, rig=path)
    assert refused.exit_code == 2
    assert "a moteus has no endpoints" in refused.err

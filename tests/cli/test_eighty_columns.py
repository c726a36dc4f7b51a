"""Everything that commands print fits a terminal of 80 columns, is plain where no terminal is,
and can be written in any encoding.
"""

import io
import json
import re
import shutil
import sys
from pathlib import Path

import pytest
import typer

from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.analysis.fitting.result import FittedParameter, _line
from rfca_rig.cli.main import app
from rfca_rig.cli.terminal import use_ascii_fallback, wrap_line
from rfca_rig.errors import BadInput
from tests.cli.typed import typed
from tests.logbook.made import TRIPPED, plan, run

ROOT = Path(__file__).parents[2]
SMALL = ROOT / "tests" / "data" / "small-campaign"
BOXES = re.compile("[\u2500-\u257f\x1b]")


def every_command(command=None, path=()):
    command = typer.main.get_command(app) if command is None else command
    yield path
    for name, below in getattr(command, "commands", {}).items():
        yield from every_command(below, (*path, name))


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


@pytest.mark.parametrize("path", list(every_command()), ids=" ".join)
def test_every_help_fits(here, monkeypatch, capsys, path):
    said = typed(monkeypatch, capsys, *path, "--help")
    assert said.exit_code == 0
    assert "Usage" in said.out
    assert max(map(len, said.out.splitlines())) <= 80
    assert "\x1b" not in said.out


OUTPUTS = (
    ("predict", "--height", "215", "--speed", "2.433"),
    ("predict", "--height", "400", "--speed", "2"),
    ("strip",),
    ("plan", "table2", "--all"),
    ("plan", "impact", "--all"),
    ("plan", "static-angle"),
    ("plan", "bending"),
    ("plan", "fatigue"),
    ("runs",),
    ("trip", "F-02"),
)


@pytest.mark.parametrize("words", OUTPUTS, ids=" ".join)
def test_every_result_fits_and_is_plain_where_it_is_piped(here, monkeypatch, capsys, words):
    run(here / "runs" / "SIM-one", plan("table2"), ending=TRIPPED)
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 0
    wide = [line for line in said.out.splitlines() if len(line) > 80]
    assert wide == []
    assert said.out.strip()
    assert not BOXES.search(said.out + said.err)


@pytest.mark.parametrize("parameter", PARAMETERS.values(), ids=PARAMETERS)
def test_a_fitted_parameter_fits_whatever_its_size(parameter):
    fitted_to = FittedParameter(
        parameter.name,
        parameter.unit,
        -1.23456e-11,
        1.2345e-12,
        -1.23456e-11,
        1.2e-12,
        -12.34,
        False,
    )
    assert len(_line(fitted_to)) <= 80


def test_prose_goes_on_between_words_and_a_path_stays_whole():
    path = "runs/" + "x" * 90
    assert wrap_line("a " * 60, 80) == ["a " * 39 + "a", "  " + "a " * 19 + "a"]
    assert f"  {path}" in wrap_line(f"the recording is in {path} now", 80)
    assert wrap_line("short") == ["short"]


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp1252", "utf-8"])
def test_what_an_encoding_cannot_carry_is_written_in_another_way(monkeypatch, encoding):
    held = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(held, encoding=encoding))
    use_ascii_fallback()
    text = "K\u00f6lle \u00b1 7\u00b0 \u2212 \u6f22 \U0001d6fc \udce9"
    print(json.dumps(text, ensure_ascii=False))
    sys.stdout.flush()
    written = held.getvalue().decode(encoding)
    back = json.loads(written)
    assert back.startswith("K\u00f6lle")
    assert {
        "ascii": "+- 7 deg - \u6f22 \U0001d6fc",
        "utf-8": "\u00b1 7\u00b0 \u2212 \u6f22 \U0001d6fc",
    }.get(encoding, "\u6f22 \U0001d6fc") in back


def test_no_colour_means_no_colour(here, monkeypatch, capsys):
    from rfca_rig.cli.commands.doctor import _colour_word
    from rfca_rig.devices.checks import green

    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert "\x1b" in _colour_word(green("clock", "ticks"))
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in _colour_word(green("clock", "ticks"))


MISTAKES = {
    "a protocol misspelt": (("plan", "tabel2"), "did you mean table2?"),
    "a rig misspelt": (
        ("predict", "--height", "215", "--speed", "2", "--rig", "twn"),
        "did you mean twin?",
    ),
    "a phase misspelt": (("fit", SMALL, "--phases", "loadin"), "did you mean loading?"),
    "a parameter misspelt": (
        ("fit", SMALL, "--parameters", "k"),
        "'k' is no parameter",
    ),
    "a command misspelt": (("dynamc", "run"), "Did you mean 'dynamic'?"),
    "an option misspelt": (("dynamic", "run", "--hieght", "3"), "--height"),
    "a run misspelt": (("check", "rnu"), "did you mean run?"),
    "a folder where a file goes": (
        ("predict", "--height", "215", "--speed", "2", "--csv", "run"),
        "is a folder",
    ),
    "a file where a folder goes": (("report", SMALL, "--out", "text"), "is a file"),
    "a file below which a folder goes": (("diagnose", SMALL, "--out", "text/below"), "is a file"),
    "a file where runs go": (
        ("dynamic", "run", "--height", "215", "--speed", "3", "--runs", "text"),
        "is a file",
    ),
    "a folder that is not there": (
        ("fit", SMALL, "--out", "nofolder/fitted.toml"),
        "there is no folder nofolder",
    ),
    "more strokes than can be": (
        ("dynamic", "run", "--height", "215", "--speed", "3", "--repeats", "100000000"),
        "--repeats",
    ),
    "more cycles than can be": (("fatigue", "run", "--cycles", "999999999999"), "--cycles"),
    "no number": (("predict", "--height", "nan", "--speed", "2"), "--height"),
    "no number for a stroke": (("dynamic", "run", "--height", "215", "--speed", "nan"), "finite"),
    "a folder without a run": (("check", "empty"), "rfca-rig runs"),
    "a folder without a recording": (("report", "empty"), "no campaign and no run"),
    "a file without a recording": (("report", "text"), "is not a recording"),
    "an empty recording": (("diagnose", "empty.h5"), "not a whole recording"),
    "a damaged recording without its stages": (("recover", "cut"), "no stage files beside it"),
    "nothing to resume": (("resume", "text"), "no run that could go on"),
    "a rig without sections": (("dynamic", "run", "--rig", "empty.toml"), "empty.toml"),
    "an import below a file": (("import", SMALL, "--out", "text/below"), "in its way"),
}


@pytest.mark.parametrize("words, said", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_with_what_to_do_and_leaves_nothing(
    here, monkeypatch, capsys, words, said
):
    (here / "run").mkdir()
    (here / "run" / "run.json").write_text("{}")
    (here / "empty").mkdir()
    (here / "cut").mkdir()
    (here / "cut" / "run.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(500))
    for name in ("empty.h5", "empty.toml", "text"):
        (here / name).touch()
    before = sorted(here.rglob("*"))
    answer = typed(monkeypatch, capsys, *words)
    assert (answer.exit_code, answer.out) == (BadInput.exit_code, "")
    lines = [line for line in answer.err.splitlines() if not line.startswith("SIM")]
    assert len(lines) == 1
    assert lines[0].startswith("rfca-rig: ")
    assert said in lines[0]
    assert sorted(here.rglob("*")) == before
    shutil.rmtree(here / "run")

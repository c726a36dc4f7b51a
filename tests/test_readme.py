"""What README, commands, model and library pages say is so: commands run, snippets run, figures
are the model's.
"""

import json
import os
import re
import shlex
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.analysis.prediction import predict_stroke
from rfca_rig.description.rig_file import read_rig
from tests.cli.typed import Said, typed, typed_in

if sys.platform != "win32":
    import fcntl

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS, MODEL, LIBRARY = (
    (ROOT / "docs" / name).read_text() for name in ("commands.md", "model.md", "library.md")
)


def block(mark: str, text: str = README) -> str:
    return re.search(rf"<!-- {mark} -->\n```sh\n(.*?)```", text, re.DOTALL)[1]


def snippet(text: str) -> str:
    return re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """A folder that looks like a fresh clone to the commands."""
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_the_commands_run_as_written(clone, monkeypatch, capsys):
    for line in block("run", COMMANDS).splitlines():
        program, *words = shlex.split(line)
        assert program == "rfca-rig"
        assert typed(monkeypatch, capsys, *words).exit_code == 0, line


@pytest.mark.slow
def test_a_concealed_effect_is_found_as_shown(clone, monkeypatch, capsys):
    # There is no earlier run here.
    for line in block("riddle").replace("-002", "-001").splitlines():
        program, *words = shlex.split(line)
        assert program == "rfca-rig"
        said = typed(monkeypatch, capsys, *words)
        assert said.exit_code == 0, line
    shown = re.search(r"```text\n(concealed: .*?)\n```", README)[1]
    assert said.out.splitlines()[-1] == shown


@pytest.mark.slow
def test_the_next_five_minutes_are_as_shown(clone, monkeypatch, capsys):
    """All but the view, which goes on until somebody ends it."""
    exit_codes = {"doctor": (0, 1), "dynamic": (3,)}
    shown = " ".join(
        re.search(r"```text\n(SIM flap .*?TRIP.*?)\n```", README, re.DOTALL)[1].split()
    )
    for line in block("minutes").splitlines():
        program, *words = shlex.split(line)
        if program == "rfca-rig" and words[0] != "view":
            said = typed(monkeypatch, capsys, *words)
            assert said.exit_code in exit_codes.get(words[0], (0,)), line
            if words[0] == "dynamic":
                assert all(
                    " ".join(told.split()) in " ".join(said.err.split())
                    for told in shown.split(" ... ")
                )


@dataclass(frozen=True)
class WholeJob:
    """Where the README's job was done, and what its run and its diagnosis left on the terminal."""

    folder: Path
    ran: Said
    diagnosed: Said


def do_whole_job(tmp_path_factory) -> WholeJob:
    """Does the README's job, once for all tests of a session, in whichever process; its
    diagnosis takes a minute.
    """
    place = tmp_path_factory.getbasetemp()
    # The folder of each process of pytest-xdist stands in that of the session.
    folder = (place.parent if "PYTEST_XDIST_WORKER" in os.environ else place) / "whole-job"
    folder.mkdir(exist_ok=True)
    said = folder / "said.json"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not said.is_file():
            run, diagnose = (shlex.split(part) for part in block("job").split("&&")[-2:])
            assert run[0] == diagnose[0] == ".venv/bin/rfca-rig"
            said.write_text(
                json.dumps([asdict(typed_in(folder, *words)) for words in (run[1:], diagnose[1:])])
            )
    return WholeJob(folder, *(Said(**one) for one in json.loads(said.read_text())))


@pytest.mark.slow
def test_the_whole_job_ends_in_a_report_and_the_snippet_reads_its_recording(
    tmp_path_factory, monkeypatch, capsys
):
    job = do_whole_job(tmp_path_factory)
    monkeypatch.chdir(job.folder)
    assert job.ran.exit_code == 0
    assert Path("report", "report.html").stat().st_size > 100_000
    shown = re.search(
        r"average error of the valley ([\d.]+) % in time, ([\d.]+) % in force", README
    ).groups()
    assert (
        re.search(
            r"average error of the valley ([\d.]+) % in time, ([\d.]+) % in force", job.ran.err
        ).groups()
        == shown
    )
    assert job.diagnosed.exit_code == 0
    assert (
        job.diagnosed.out.splitlines()[:2]
        == re.search(r"```text\n(IDENTIFIED.*?)\nmotor", README, re.DOTALL)[1].splitlines()
    )
    proof = r"left out in turn, shaft as commanded: fz (\S+) -> (\S+) N \(noise and scatter (\S+)\)"
    shown = re.search(proof, " ".join(README.split())).groups()
    said = re.search(proof, " ".join(job.diagnosed.out.split())).groups()
    before, after, floor = map(float, said)
    assert (before, after, floor) == pytest.approx(tuple(map(float, shown)), rel=0.1)
    assert after < 0.03 * before
    (effect,) = json.loads(Path("diagnosis", "diagnosis.json").read_text())["effects"]
    assert effect["id"] == "motor_speed_droop"
    assert (
        typed(monkeypatch, capsys, "runs", "--verdict", "motor_speed_droop", "--paths").out
        == "runs/SIM-table-ii-001\n"
    )
    for name, true in (("kp_Nm_s_per_rad", 8.0), ("ki_Nm_per_rad", 60.0)):
        found = effect["parameters"][name]
        assert found["value"] == pytest.approx(true, rel=0.06)
        assert abs(found["value"] - true) < 1.645 * found["std"] < 0.1 * true
    # The command that the diagnosis ends with, as it is printed.
    compare = re.search(r"new model: rfca-rig (.*)", job.diagnosed.err)[1].split()
    compared = typed(monkeypatch, capsys, *compare).err
    errors = re.search(r"valley (\S+) % in time, (\S+) % in force, shaft as commanded", compared)
    assert float(errors[1]) <= 0.1 and float(errors[2]) <= 0.5
    names: dict[str, object] = {}
    exec(snippet(README), names)
    assert len(names["fz"]) > 10_000 and len(names["predicted"]["fz_N"]) > 1000


@pytest.mark.slow
def test_the_snippet_of_the_library_runs(clone):
    names: dict[str, object] = {}
    exec(snippet(LIBRARY), names)
    assert (
        len(names["measured"]) > 1000
        and len(names["table"]) == 1
        and (clone / "report" / "report.html").is_file()
    )


def read_evidence():
    """Effects, families, wrong and silent of each row of the README's table, by the first number of
    the row's label.
    """
    rows = {}
    for label, *cells in re.findall(r"^\| (.*)" + 4 * r" \| (\d+)" + r" \|$", README, re.MULTILINE):
        words = re.sub(r"\([^)]*\)", "", label)
        rows[int(re.search(r"\d+", words)[0])] = tuple(map(int, cells))
    return rows


def test_the_evidence_has_the_numbers_of_the_documents():
    trust = (ROOT / "docs" / "how-far-to-trust-a-diagnosis.md").read_text(encoding="utf-8")
    mechanisms = (ROOT / "docs" / "mechanisms.md").read_text(encoding="utf-8")
    evidence = read_evidence()
    assert len(evidence) == 4
    assert all(sum(counts) == cases for cases, counts in evidence.items())
    # Real sets: in the table of answers an effect, or only a family.
    assert "In nine sets an effect or a family is reported. In five" in trust.replace("\n", " ")
    grades = {}
    for sets, before, now in re.findall(
        r"^\| ((?:`[\w-]+`(?:, )?)+) \| ([^|]*) \| ([^|]*) \|$", trust, re.MULTILINE
    ):
        answer = before if now == "the same" or now.startswith("the same (") else now
        grades.update(dict.fromkeys(re.findall(r"`([\w-]+)`", sets), answer))
    families = [name for name, answer in grades.items() if answer.startswith("family")]
    assert len(grades) == 14
    assert evidence[14] == (9 - len(families), len(families), 0, 5)
    # Servos: right, family and silent of weights and arms, by size.
    cells = r"(\d), (\d), (\d)"
    servos = re.findall(rf"^\| [^|]* \| {cells} \| (?:{cells}|none drawn) \|", trust, re.MULTILINE)
    counts = [int(cell or 0) for row in servos for cell in row]
    right, family, silent = np.reshape(counts, (-1, 3)).sum(axis=0)
    assert evidence[28] == (right, family, 0, silent)
    assert "None of the 28 changes is misstated" in trust
    # Legs of the blind benchmark.
    assert "one detectable effect: is exactly it reported? | 95 % | **36 of 39** |" in trust
    assert "one detectable effect: is it or its family reported? | 95 % | 37 of 39 |" in trust
    assert evidence[39] == (36, 1, 0, 2)
    # Arms and hoppers: of those that are right, the families.
    row = re.search(r"one effect: right, of these as its family \| 85 % \|(.*)", mechanisms)[1]
    right_and_family = re.findall(r"\*\*(\d+) of 33\*\*, (\d+)", row)
    right, family = np.array(right_and_family, dtype=int).sum(axis=0)
    assert evidence[99] == (right - family, family, 2, 99 - right - 2)
    assert "Wrong are 2 of 99" in mechanisms
    # Newer cases: statements that are wrong, of both seeds.
    wrong, of = np.array(read_pair(trust, "effect or family reported: is it wrong?")).sum(axis=0)
    assert f"{wrong} of {of}\nstatements are wrong" in README
    # Nothing hidden: legs, servos, arms and hoppers, newer legs and pendulums.
    hidden = [(0, 104), (0, 12), (0, 51)]
    assert "0 of 104" in trust and "12 pairs without a change" in trust
    assert mechanisms.count("0 of 17") == 3
    hidden += read_pair(trust, "nothing is missing in a leg: is an effect reported anyway?")
    hidden += read_pair(trust, "nothing is missing in a pendulum: is an effect reported anyway?")
    wrong, of = np.array(hidden).sum(axis=0)
    assert f"With nothing hidden, {wrong} of {of} simulated cases has a statement" in README


def read_pair(text, question):
    """The last table row with this question and two answers, "k of n" for both seeds."""
    rows = re.findall(rf"^\| {re.escape(question)} \|(.*)\|(.*)\|$", text, re.MULTILINE)
    return [tuple(map(int, re.search(r"(\d+) of (\d+)", cell).groups())) for cell in rows[-1]]


def test_the_readme_is_short_and_its_sentences_are_too():
    text = re.sub(r"```.*?```|\]\([^)]*\)|<!--.*?-->", "", README, flags=re.DOTALL)
    assert len(text.split()) <= 950
    sentences = re.split(r"(?<=[.!?:;])\s+|\n\n|\n- |\n\|", text)
    assert max(len(sentence.split()) for sentence in sentences) <= 25


def test_every_link_of_the_readme_leads_somewhere():
    links = re.findall(r"\]\(([^)#]+)", README)
    assert len(links) > 20
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_both_set_up_commands_start_from_nothing_but_python():
    for mark in ("job", "test"):
        assert block(mark).startswith(
            "python3 -m venv .venv && .venv/bin/pip install -q --no-compile -c constraints.txt -e "
        )


def test_the_model_s_column_of_table_2_is_what_the_model_says():
    rows = re.findall(r"\| (\d+) mm, ([\d.]+) rad/s \|.*\| ([\d.]+) s, (-[\d.]+) N \|", MODEL)
    assert len(rows) == 4
    model = read_rig(ROOT / "calibration" / "twin.toml").model()
    for height_mm, speed, time_s, fz_N in rows:
        found = predict_stroke(model, float(height_mm) / 1e3, float(speed), 200.0).summary()
        assert f"{found['valley_time_s']:.3f}" == time_s
        assert f"{found['valley_fz_N']:.2f}" == fz_N


def test_constraints_name_no_host_and_pin_every_dependency():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9_.+!-]+", line) for line in lines)
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in lines}
    wanted = re.findall(
        r'^    "([A-Za-z0-9-]+)[><=]', (ROOT / "pyproject.toml").read_text(), re.MULTILINE
    )
    assert wanted
    assert {name.lower() for name in wanted} <= pinned

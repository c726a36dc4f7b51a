"""`reference set`: later runs of a rig end with what has changed, and a gate refuses them."""

import json
import shutil
from dataclasses import replace

import pytest

from rfca_rig.cli.since_reference import SinceReference, pass_gate
from rfca_rig.errors import Changed
from rfca_rig.logbook.references import (
    REFERENCES,
    RigIdentity,
    find_reference,
    identify_rig,
    read_references,
    set_reference,
)
from tests.cli.test_eighty_columns import SMALL
from tests.cli.typed import typed
from tests.diagnosis.test_invariants import IDENTIFIED


@pytest.fixture
def say(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    return lambda *words: typed(monkeypatch, capsys, *words)


def make_run(runs, name, rig="leg-a", sample="s1"):
    """A folder with the header of a run, which is all that says whose it is."""
    folder = runs / name
    folder.mkdir(parents=True)
    provenance = {"rig": rig, "sample": sample}
    header = {"title": name, "source": "SIM", "provenance": provenance}
    (folder / "run.json").write_text(json.dumps(header), encoding="utf-8")
    return folder


def test_a_rig_is_its_file_and_the_specimen_on_it(tmp_path):
    by_path = make_run(tmp_path, "one", rig="/lab/calibration/leg-a.toml")
    assert identify_rig(by_path) == RigIdentity("leg-a", "s1")
    assert identify_rig(make_run(tmp_path, "two")) == identify_rig(by_path)


def test_a_later_run_of_the_rig_has_the_reference_and_no_other_run(tmp_path):
    first, second, later = (make_run(tmp_path, name) for name in ("one", "two", "three"))
    other_sample = make_run(tmp_path, "four", sample="s2")
    set_reference([first, second])
    assert find_reference(later) == (first, second)
    assert find_reference(first) == ()
    assert find_reference(other_sample) == ()
    assert find_reference(make_run(tmp_path / "elsewhere", "five")) == ()


def test_each_rig_keeps_its_own_reference(tmp_path):
    one = make_run(tmp_path, "one")
    two = make_run(tmp_path, "two", rig="leg-b")
    three = make_run(tmp_path, "three")
    set_reference([one])
    set_reference([two])
    set_reference([three])
    kept = {reference.identity.rig: reference.runs for reference in read_references(tmp_path)}
    assert kept == {"leg-a": ("three",), "leg-b": ("two",)}


def test_a_campaign_from_elsewhere_can_be_a_reference(say, tmp_path):
    shutil.copytree(SMALL, tmp_path / "march")
    said = say("reference", "set", "march")
    assert said.exit_code == 0, said.err
    assert "one run does not show how much runs differ" in said.err
    shown = say("reference", "show", ".")
    assert shown.out.strip() == "recordings that name no rig: march"
    assert json.loads(say("reference", "show", ".", "--json").out)[0]["runs"] == ["march"]
    assert "no longer a reference: march" in say("reference", "clear", "march").err
    assert say("reference", "show", ".").out == ""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("set", "nowhere"), "holds no recording"),
        (("set", "one", "other"), "of rig leg-b, sample s1"),
        (("set", "one", "deeper/two"), "lies in another folder"),
        (("history", "."), "has no reference"),
    ],
    ids=["nothing there", "two rigs", "two folders", "no reference"],
)
def test_what_cannot_be_a_reference_is_refused_in_one_line(say, tmp_path, words, message):
    make_run(tmp_path, "one")
    make_run(tmp_path, "other", rig="leg-b")
    make_run(tmp_path / "deeper", "two")
    said = say("reference", *words)
    assert said.exit_code == 2
    assert message in " ".join(said.err.split())
    assert "Traceback" not in said.err
    assert not (tmp_path / REFERENCES).exists()


def test_a_damaged_file_of_references_is_named(say, tmp_path):
    shutil.copytree(SMALL, tmp_path / "april")
    (tmp_path / REFERENCES).write_text('format = "rfca-references/1"\nrun = 3\n', encoding="utf-8")
    said = say("reference", "show", ".")
    assert said.exit_code == 2
    assert REFERENCES in said.err
    # A check says so, and is no failure of the recording.
    checked = say("check", "april")
    assert checked.exit_code == 0
    assert "not compared with its reference" in checked.err
    assert say("check", "april", "--gate").exit_code == 2


def test_a_gate_needs_a_reference(say, tmp_path):
    shutil.copytree(SMALL, tmp_path / "april")
    said = say("check", "april", "--gate")
    assert said.exit_code == 2
    assert "reference set RUN" in " ".join(said.err.split())
    assert say("check", "april").exit_code == 0


def list_runs(folder):
    """Names of the runs, in the order in which they were made."""
    return sorted(path.name for path in (folder / "runs").iterdir() if path.is_dir())


@pytest.mark.slow
def test_a_run_ends_with_what_has_changed(say, tmp_path):
    """On the twin: a reference of two runs, a run of the same leg, and one of a softer leg."""
    twin = (find_calibration() / "twin.toml").read_text(encoding="utf-8")
    nominal = twin[twin.index("[leg]") : twin.index("[limits]")]
    (tmp_path / "nominal.toml").write_text(nominal, encoding="utf-8")
    softer = twin.replace("k0_Nm_per_rad = 10.98", "k0_Nm_per_rad = 10.0")
    for name, text in (("as-it-was", twin), ("worn", softer)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "leg.toml").write_text(text, encoding="utf-8")

    def flap(name, seed, *words):
        return say(
            "dynamic",
            "run",
            *("--protocol", "table2", "--repeats", "2", "--model", "nominal.toml"),
            *("--rig", f"{name}/leg.toml", "--seed", str(seed)),
            *words,
        )

    assert flap("as-it-was", 1).exit_code == 0
    assert flap("as-it-was", 2).exit_code == 0
    first, second = list_runs(tmp_path)
    assert say("reference", "set", f"runs/{first}", f"runs/{second}").exit_code == 0
    same = flap("as-it-was", 3, "--gate", "--json")
    assert same.exit_code == 0, same.err
    answer = json.loads(same.out)["since_reference"]
    assert answer["reference"] == [first, second]
    assert answer["grade"] == "nothing missing"
    worn = flap("worn", 4, "--gate")
    assert worn.exit_code == 3
    assert "k0_change" in worn.err
    assert "recorded 8 strokes" in worn.err
    # The run is whole, whatever the gate says.
    last = list_runs(tmp_path)[-1]
    checked = say("check", f"runs/{last}")
    assert checked.exit_code == 0
    assert "k0_change" in checked.err
    # The history of both has the change of the last run.
    history = say("reference", "history", "runs", "--json")
    assert history.exit_code == 0, history.err
    told = json.loads(history.out)
    changes = [run["changes"]["k0"]["value"] for run in told["runs"]]
    assert changes == pytest.approx([0.0, 100.0 * (10.0 / 10.98 - 1.0)], abs=0.8)
    assert told["sentence"] in (tmp_path / "history" / "history.html").read_text(encoding="utf-8")


def find_calibration():
    from rfca_rig.cli.paths import folders_of

    return next(folder for folder in folders_of("calibration") if (folder / "twin.toml").is_file())


@pytest.mark.parametrize(
    ("grade", "probability", "has_changed"),
    [
        ("identified", 0.95, True),
        ("unexplained", 0.9, True),
        # More probably than not nothing has changed.
        ("unexplained", 0.37, False),
        ("nothing missing", 0.6, False),
        ("not enough data", None, False),
    ],
)
def test_a_gate_refuses_what_has_more_probably_changed_than_not(grade, probability, has_changed):
    diagnosis = replace(IDENTIFIED, grade=grade, probability=probability)
    answer = SinceReference(("one",), diagnosis)
    assert answer.has_changed is has_changed
    if has_changed:
        with pytest.raises(Changed):
            pass_gate(answer, is_gate=True)
    else:
        pass_gate(answer, is_gate=True)
    pass_gate(answer, is_gate=False)

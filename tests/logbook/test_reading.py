"""A line of the logbook says what the recording itself says."""

import json
from pathlib import Path

import pytest

from rfca_rig.campaign.opening import import_campaign
from rfca_rig.logbook.entry import Entry, LoggedCondition, entry_of
from rfca_rig.logbook.reading import read_entry
from rfca_rig.recording.layout import identity_of
from rfca_rig.recording.store import read_recording
from tests.cli.typed import typed
from tests.logbook.made import DONE, ROOT, STOPPED, TRIPPED, plan, run


def as_recorded(path: Path) -> dict[str, object]:
    """The same of the recording, by the way that analyses read it."""
    recording = read_recording(path)
    strokes = {
        LoggedCondition(round(1e3 * s.height_m, 6), s.speed_rad_s) for s in recording.strokes
    }
    stages = {LoggedCondition(round(1e3 * s.height_m, 6)) for s in recording.static}
    identity = identity_of(recording.title, recording.source, recording.provenance)
    return {
        "title": recording.title,
        "source": recording.source,
        "conditions": strokes | stages,
        "strokes": len(recording.strokes),
        "static_stages": len(recording.static),
        "identity": identity,
    }


def as_listed(entry: Entry) -> dict[str, object]:
    return {
        "title": entry.title,
        "source": entry.source,
        "conditions": set(entry.conditions),
        "strokes": entry.strokes,
        "static_stages": entry.static_stages,
        "identity": entry.identity,
    }


@pytest.mark.slow
def test_a_run_is_listed_as_it_was_recorded(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = (
        "--height",
        215,
        "--speed",
        3.249,
        "--repeats",
        2,
        "--operator",
        "M. Kölle",
        "--sample",
        "leg 7",
    )
    folder = Path(
        json.loads(typed(monkeypatch, capsys, "dynamic", "run", *words, "--json").out)["run"]
    )
    entry = read_entry(Path("runs"), folder.name)
    assert as_listed(entry) == as_recorded(folder / "run.h5")
    assert (entry.kind, entry.ended, entry.operator, entry.sample) == (
        "dynamic",
        "done",
        "M. Kölle",
        "leg 7",
    )
    (folder / "run.json").unlink()
    assert as_listed(read_entry(Path("runs"), folder.name)) == as_listed(entry), "from run.h5 alone"


def test_an_imported_campaign_is_listed_as_it_was_recorded(tmp_path):
    import_campaign(ROOT / "tests" / "data" / "small-campaign", tmp_path / "IMPORT-small")
    entry = read_entry(tmp_path, "IMPORT-small")
    assert as_listed(entry) == as_recorded(tmp_path / "IMPORT-small" / "run.h5")
    assert (entry.kind, entry.ended) == ("imported", "")


@pytest.mark.parametrize(
    ("ending", "ended", "code"),
    [
        (DONE, "done", ""),
        (TRIPPED, "tripped", "F-02"),
        (STOPPED, "stopped", ""),
        ({"ended": "the leg is worn", "reason": "worn-out"}, "worn out", ""),
        ({"ended": "stopped: disk full", "reason": "disk-full"}, "failed", ""),
        ({"interrupted": "the run ended without being finished"}, "interrupted", ""),
        (None, "unfinished", ""),
    ],
)
def test_every_ending_has_its_word(tmp_path, ending, ended, code):
    entry = read_entry(run(tmp_path / "one", plan("flapping"), ending=ending).parent, "one")
    assert (entry.ended, entry.code) == (ended, code)


def test_only_what_was_recorded_counts_and_what_had_begun_is_found(tmp_path):
    planned = plan("table2")
    folder = run(tmp_path / "one", planned, recorded=6, ending=STOPPED)
    cut = next(flap for flap in planned.flaps if flap.height_m > 0.22)
    with (folder / "events.jsonl").open("a") as events:
        events.write(json.dumps({"event": "stage begins", "stage": cut.label}) + "\n")
        events.write(json.dumps({"event": "stage cut short", "why": "stopped"}) + "\n")
    entry = read_entry(tmp_path, "one")
    assert entry.strokes == 6
    assert entry.conditions == (
        LoggedCondition(215.0, 2.433),
        LoggedCondition(215.0, 3.249),
        LoggedCondition(235.0, 2.478),
    )


def test_a_stage_that_a_crash_took_is_not_the_one_recorded_after_it(tmp_path):
    planned = plan("fatigue")
    folder = run(tmp_path / "one", planned, recorded=0)
    with (folder / "events.jsonl").open("a") as events:
        for event in (begins(planned.holds[0]), {"event": "run resumed"}, begins(planned.flaps[0])):
            events.write(json.dumps(event) + "\n")
        events.write(
            json.dumps({"event": "stage recorded", "samples": {}}) + '\n{"event": "half a li'
        )
    entry = read_entry(tmp_path, "one")
    assert (entry.strokes, entry.static_stages, entry.ended) == (1, 0, "unfinished")


def begins(stage):
    return {"event": "stage begins", "stage": stage.label}


@pytest.mark.parametrize("victim", ["run.json", "end.json", "events.jsonl"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe{", b"[1, 2]\n", b'{"format": 1}\n', b"null\n"])
def test_damage_is_listed_and_stops_nothing(tmp_path, victim, content):
    folder = run(tmp_path / "one", plan("flapping"), ending=DONE)
    (folder / victim).write_bytes(content)
    entry = read_entry(tmp_path, "one")
    assert entry.folder == "one"
    if (victim, content) != ("events.jsonl", b""):
        assert entry.ended == "damaged" or (content == b"\xff\xfe{" and victim == "events.jsonl")
    assert entry_of(json.loads(json.dumps(entry.plain()))) == entry


def test_a_damaged_recording_is_listed_as_damaged(tmp_path):
    import_campaign(ROOT / "tests" / "data" / "small-campaign", tmp_path / "IMPORT-small")
    path = tmp_path / "IMPORT-small" / "run.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    entry = read_entry(tmp_path, "IMPORT-small")
    assert (entry.ended, "checksum" in entry.why) == ("damaged", True)

"""A run's folder: what comes in block by block is there, whole, as soon as it is acknowledged,
and is put together at the end.
"""

import hashlib
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.opening import open_recordings
from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.checking import check_run, needs_no_recovery
from rfca_rig.recording.journal import frame_block, parse_blocks
from rfca_rig.recording.layout import journals, stage_files
from rfca_rig.recording.run_folder import partial_of, read_partial, recover_partial
from rfca_rig.recording.run_text import Ending, events_of, read_ending, write_ending
from rfca_rig.recording.store import read_recording, write_recording
from tests.recording.growing import PER_TICK, begun, expected, grown, header, stroke_blocks
from tests.recording.same import assert_same
from tests.recording.samples import recording, stage, stroke


def finished(folder: Path, count: int = 4) -> Path:
    grown(folder, count).finish("done")
    write_ending(folder, Ending({"ended": "done"}))
    return run_folder.build_recording(folder)


def without_words(found):
    return replace(found, nominal={}, known_to={}, provenance={})


def test_what_was_handed_over_block_by_block_is_the_recording(tmp_path: Path):
    found = read_recording(finished(tmp_path / "run"))
    assert_same(without_words(found), expected(4))
    assert (found.nominal, found.known_to) == (header().nominal, header().known_to)
    assert (found.provenance["ended"], found.provenance["seed"]) == ("done", "7")


def test_each_stage_is_readable_alone_as_soon_as_it_is_acknowledged(tmp_path: Path):
    keeper = grown(tmp_path / "run", 0)
    for number in (1, 2, 3):
        for block in stroke_blocks(number):
            keeper.give(block)
        assert keeper.acknowledged == number
        assert [
            read_recording(file).strokes[0].repeat for file in stage_files(tmp_path / "run")
        ] == list(range(1, number + 1))
        assert journals(tmp_path / "run") == []
        assert len(open_recordings([tmp_path / "run"])[0].strokes) == number


def test_the_file_is_made_anew_from_the_stages_byte_for_byte(tmp_path: Path):
    path = finished(tmp_path / "run")
    before = path.read_bytes()
    path.unlink()
    assert not needs_no_recovery(tmp_path / "run", check_run(tmp_path / "run"))
    assert run_folder.build_recording(tmp_path / "run").read_bytes() == before
    assert needs_no_recovery(tmp_path / "run", check_run(tmp_path / "run"))


def test_sha256sum_finds_everything_in_order(tmp_path: Path):
    finished(tmp_path / "run")
    (tmp_path / "run" / "stages" / "0001.h5").write_bytes(b"damaged")
    lines = (tmp_path / "run" / "SHA256SUMS").read_text().splitlines()
    assert [line.split("  ")[1] for line in lines] == [
        *("end.json", "events.jsonl", "photos/001.png", "run.h5", "run.json"),
        *(f"stages/000{number}.h5" for number in (1, 2, 3, 4)),
    ]
    checker = shutil.which("sha256sum")
    if checker:
        told = subprocess.run(
            [checker, "-c", "SHA256SUMS"],
            cwd=tmp_path / "run",
            capture_output=True,
            text=True,
            check=False,
        ).stdout
        assert [line.endswith(": OK") for line in told.splitlines()] == [
            True,
            True,
            True,
            True,
            True,
            False,
            True,
            True,
            True,
        ]


def test_events_say_what_reached_the_disk(tmp_path: Path):
    finished(tmp_path / "run", 2)
    events = events_of(tmp_path / "run")
    assert [event["event"] for event in events] == [
        "stage begins",
        "stage recorded",
        "stage begins",
        "stage recorded",
        "run ends",
    ]
    said = events[1]
    assert (
        said["sha256"] == hashlib.sha256((tmp_path / "run" / said["file"]).read_bytes()).hexdigest()
    )
    assert said["samples"] == {"shaft": 12, "force": 12 * PER_TICK}


def test_a_stage_cut_short_keeps_its_samples_and_says_why(tmp_path: Path):
    keeper = grown(tmp_path / "run", 1)
    for block in begun(2, ticks=7):
        keeper.give(block)
    keeper.finish("force 301 N, limit 300 N")
    (raw,) = run_folder.read_stages(tmp_path / "run").raw
    assert (raw.label, raw.cut_short) == ("stage 2", "force 301 N, limit 300 N")
    assert len(raw.streams["force"].t_s) == 7 * PER_TICK
    assert abs(raw.streams["force"].t_s[0] + 0.25) < 2e-3, (
        "counted from the commanded start, which had come"
    )


def test_a_stage_cut_short_before_its_commanded_start_counts_from_its_first_sample(tmp_path: Path):
    keeper = grown(tmp_path / "run", 0)
    for block in begun(1, ticks=2):
        keeper.give(block)
    keeper.finish("stopped")
    (raw,) = run_folder.read_stages(tmp_path / "run").raw
    assert abs(min(stream.t_s[0] for stream in raw.streams.values())) < 2e-3


def test_a_stage_without_a_single_sample_leaves_nothing(tmp_path: Path):
    keeper = grown(tmp_path / "run", 0)
    for block in begun(1, ticks=0):
        keeper.give(block)
    keeper.finish("stopped")
    assert list((tmp_path / "run" / "stages").iterdir()) == []


def test_photos_read_at_the_end_take_the_place_of_what_was_recorded(tmp_path: Path):
    grown(tmp_path / "run", 2).finish("done")
    seen = replace(
        stage(2),
        hinge_deg=(1.0, 2.0, 3.0, 4.0, 5.0, float("nan")),
        overlay="overlays/002.jpg",
        photo_doubts="hinge 7 left out",
    )
    write_ending(tmp_path / "run", Ending({"ended": "done"}, (seen,)))
    assert repr(read_ending(tmp_path / "run").static) == repr((seen,))
    found = read_recording(run_folder.build_recording(tmp_path / "run"))
    assert repr(found.static) == repr((seen,))
    assert len(found.raw) == 1


def test_recordings_are_never_written_over(tmp_path: Path):
    path = finished(tmp_path / "run", 1)
    with pytest.raises(BadInput, match="holds a run already"):
        run_folder.create(tmp_path / "run", header())
    (tmp_path / "older").mkdir()
    shutil.copy(path, tmp_path / "older" / "run.h5")
    with pytest.raises(BadInput, match="holds a run already"):
        run_folder.create(tmp_path / "older", header())


def test_a_run_that_still_goes_on_is_left_alone(tmp_path: Path):
    keeper = grown(tmp_path / "run", 1)
    with pytest.raises(BadInput, match="still going on"):
        run_folder.close_journals(tmp_path / "run")
    with pytest.raises(BadInput, match="still going on"):
        InProcessRecorder(tmp_path / "run")
    keeper.finish("done")
    assert run_folder.close_journals(tmp_path / "run") == 0


def test_a_journal_cut_or_damaged_anywhere_gives_the_blocks_before(tmp_path: Path):
    blocks = list(begun(1))
    content = b"".join(frame_block(block) for block in blocks)
    ends = np.cumsum([len(frame_block(block)) for block in blocks])
    random = np.random.default_rng(5)
    for place in [0, 1, len(content) - 1, *random.integers(0, len(content), 300)]:
        before = int(np.searchsorted(ends, place, side="right"))
        assert parse_blocks(content[:place])[0] == blocks[:before]
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(random.integers(8))
        found, used = parse_blocks(bytes(damaged))
        assert found == blocks[: len(found)]
        assert len(found) >= before
        assert used == (ends[len(found) - 1] if found else 0)


def older_partial(folder: Path) -> Path:
    """What an older version left of a run that was interrupted after one stroke and one stage."""
    path = folder / "run.h5"
    partial_of(path).mkdir(parents=True)
    bare = replace(recording(0, 0), nominal={}, known_to={}, provenance={})
    for number, part in enumerate(
        [recording(0, 0), replace(bare, strokes=(stroke(1),)), replace(bare, static=(stage(1),))]
    ):
        write_recording(part, partial_of(path) / f"{number:05d}.h5")
    (partial_of(path) / "00003.h5.writing").write_bytes(b"half")
    return path


def test_an_older_interrupted_run_still_opens_and_is_recovered(tmp_path: Path):
    path = older_partial(tmp_path)
    (found,) = open_recordings([tmp_path])
    assert "after 1 strokes and 1 static stages" in found.provenance["interrupted"]
    assert_same(without_words(found), without_words(recording(1, 1)))
    assert_same(read_recording(recover_partial(path)), found)
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]


def test_an_older_run_that_died_before_it_began_says_so(tmp_path: Path):
    partial_of(tmp_path / "run.h5").mkdir()
    with pytest.raises(BadInput, match="interrupted before it began"):
        read_partial(tmp_path / "run.h5")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.json", b"{"),
        ("run.json", b'{"format": "x"}'),
        ("end.json", b"[1]"),
        ("end.json", b"{}"),
    ],
)
def test_damaged_words_are_one_line_with_the_file(tmp_path: Path, name: str, content: bytes):
    finished(tmp_path / "run", 1)
    (tmp_path / "run" / name).write_bytes(content)
    with pytest.raises(BadInput, match=rf"run/{name}: ") as caught:
        run_folder.read_stages(tmp_path / "run")
    assert "\n" not in str(caught.value)


def test_a_writer_that_goes_on_with_a_run_leaves_no_torn_line(tmp_path: Path):
    grown(tmp_path / "run", 1).finish("the power went")
    with (tmp_path / "run" / "events.jsonl").open("a") as file:
        file.write('{"event": "to')
    keeper = InProcessRecorder(tmp_path / "run")
    for block in stroke_blocks(2):
        keeper.give(block)
    keeper.finish("done")
    assert [event.get("file") for event in events_of(tmp_path / "run") if "file" in event] == [
        "stages/0001.h5",
        "stages/0002.h5",
    ]
    assert [stroke.repeat for stroke in run_folder.read_stages(tmp_path / "run").strokes] == [1, 2]


def test_damaged_hashes_are_summed_up_anew(tmp_path: Path):
    finished(tmp_path / "run", 1)
    (tmp_path / "run" / "SHA256SUMS").write_text("nonsense")
    assert not needs_no_recovery(tmp_path / "run", check_run(tmp_path / "run"))


def test_a_half_written_event_is_passed_over(tmp_path: Path):
    finished(tmp_path / "run", 1)
    events = tmp_path / "run" / "events.jsonl"
    whole = events_of(tmp_path / "run")
    with events.open("a") as file:
        file.write(json.dumps({"event": "torn"})[:9])
    assert events_of(tmp_path / "run") == whole

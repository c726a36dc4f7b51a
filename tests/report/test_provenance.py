"""What stands at the end of a page."""

import hashlib
import re
import subprocess
from pathlib import Path

from rfca_rig.clock import TwinClock
from rfca_rig.description.sections import AboutSection
from rfca_rig.recording.store import write_recording
from rfca_rig.reports.provenance import (
    NOT_STATED,
    Origin,
    command_line,
    date_text,
    fingerprint,
    origin_in_memory,
    origin_of,
    origin_of_import,
    version_text,
)
from tests.report.recordings import recording, stages

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


def test_the_command_can_be_pasted_and_leaves_out_what_was_not_asked_for():
    options = {
        "--shaft": None,
        "--model": Path("a b.toml"),
        "--json": True,
        "--pdf": False,
        "--rounds": 2,
    }
    said = command_line(
        "report", Path("runs/my run"), Path("/home/lab/secret/run-1"), options=options
    )
    assert said == "rfca-rig report 'runs/my run' run-1 --model 'a b.toml' --json --rounds 2"


def test_a_run_is_known_by_its_file_and_a_campaign_by_all_of_its_tables(tmp_path):
    one = recording(static=stages())
    write_recording(one, tmp_path / "run.h5")
    sha256 = hashlib.sha256((tmp_path / "run.h5").read_bytes()).hexdigest()
    assert fingerprint(tmp_path) == fingerprint(tmp_path / "run.h5")
    (recorded,) = origin_of("", [tmp_path], [one]).recordings
    assert (recorded.sha256, recorded.hashed, recorded.path) == (sha256, "run.h5", tmp_path.name)
    files = sorted([SMALL / "campaign.toml", *SMALL.rglob("*.csv")])
    lines = subprocess.run(
        ["sha256sum", *(str(f.relative_to(SMALL)) for f in files)],
        cwd=SMALL,
        capture_output=True,
        check=True,
    ).stdout
    assert fingerprint(SMALL).sha256 == hashlib.sha256(lines).hexdigest()


def test_what_was_recorded_meanwhile_is_listed_without_a_hash(tmp_path):
    one = recording(static=stages())
    other = recording(static=stages(), source="SIM")
    write_recording(one, tmp_path / "run.h5")
    first, second = origin_of("", [tmp_path], [one, other]).recordings
    assert first.sha256 and not second.sha256 and second.mark == "SIM"


def test_the_version_says_the_state_of_the_source():
    assert re.fullmatch(r"\d+\.\d+\.\d+(, git [0-9a-f]{12}(, changed since)?)?", version_text())


def test_the_head_states_date_operator_specimen_rig_and_version():
    known = {
        "started_at": "2026-11-03T14:05:09+00:00",
        "operator": "Ada",
        "sample": "leg 4",
        "rig": "bench",
    }
    one = recording(static=stages(), provenance=known)
    other = recording(static=stages(), provenance={**known, "operator": "Bo"})
    facts = dict(origin_in_memory([one, other]).facts)
    assert [facts[name] for name in ("Date", "Operator", "Specimen", "Rig")] == [
        "2026-11-03 14:05 UTC",
        "Ada, Bo",
        "leg 4",
        "bench",
    ]
    # What is not stated stands together in one place.
    assert (
        dict(origin_in_memory([recording(static=stages())]).facts)[NOT_STATED]
        == "date, operator, specimen, rig"
    )
    assert [name for name, _ in Origin().facts] == ["Version"]


def test_the_head_of_a_page_of_tables_states_what_their_description_does(tmp_path):
    (tmp_path / "a.csv").write_text("t\n0\n")
    facts = dict(
        origin_of_import("", tmp_path, "arm", AboutSection(date="2026-03-14", operator="Ada")).facts
    )
    assert (facts["Date"], facts["Operator"], facts[NOT_STATED]) == (
        "2026-03-14",
        "Ada",
        "specimen, rig",
    )


def test_simulated_time_is_no_date():
    started = TwinClock().start_time().isoformat()
    assert date_text(started) == "simulated time, which has no date"
    assert date_text("yesterday") == "yesterday"

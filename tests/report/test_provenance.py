"""What stands at the end of a page."""

import hashlib
import re
import subprocess
from pathlib import Path

from rfca_rig.campaign.fingerprint import fingerprint
from rfca_rig.recording.store import write_recording
from rfca_rig.reports.provenance import command_line, origin_of, version_text
from rfca_rig.reports.templates import by_stem
from tests.report.recordings import recording, stages

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


def test_the_command_can_be_pasted_and_leaves_out_what_was_not_asked_for():
    options = {"--shaft": None, "--model": Path("a b.toml"), "--json": True, "--pdf": False, "--rounds": 2}
    said = command_line("report", Path("runs/my run"), Path("/home/lab/secret/run-1"), options=options)
    assert said == "rfca-rig report 'runs/my run' run-1 --model 'a b.toml' --json --rounds 2"


def test_a_run_is_known_by_its_file_and_a_campaign_by_all_of_its_tables(tmp_path):
    one = recording(static=stages())
    write_recording(one, tmp_path / "run.h5")
    sha256 = hashlib.sha256((tmp_path / "run.h5").read_bytes()).hexdigest()
    assert fingerprint(tmp_path) == fingerprint(tmp_path / "run.h5")
    (recorded,) = origin_of("", [tmp_path], [one]).recordings
    assert (recorded.sha256, recorded.hashed, recorded.path) == (sha256, "run.h5", tmp_path.name)
    files = sorted([SMALL / "campaign.toml", *SMALL.rglob("*.csv")])
    lines = subprocess.run(["sha256sum", *(str(f.relative_to(SMALL)) for f in files)], cwd=SMALL, capture_output=True, check=True).stdout
    assert fingerprint(SMALL).sha256 == hashlib.sha256(lines).hexdigest()


def test_what_was_recorded_meanwhile_is_listed_without_a_hash(tmp_path):
    one, other = recording(static=stages()), recording(static=stages(), source="SIM")
    write_recording(one, tmp_path / "run.h5")
    first, second = origin_of("", [tmp_path], [one, other]).recordings
    assert first.sha256 and not second.sha256 and second.mark == "SIM"


def test_the_version_says_the_state_of_the_source():
    assert re.fullmatch(r"\d+\.\d+\.\d+(, git [0-9a-f]{12}(, changed since)?)?", version_text())


def test_files_that_differ_in_their_ending_are_named_once():
    assert by_stem(["table2.csv", "table2.tex", "run-2-stages.csv", "table2.json"]) == ["table2.csv/.tex/.json", "run-2-stages.csv"]

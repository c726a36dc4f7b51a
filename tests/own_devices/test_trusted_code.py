"""A folder from elsewhere executes no Python file here; what this command line names, or what
ran here before, does.
"""

import shutil
from pathlib import Path

import pytest

from tests.cli.typed import typed
from tests.own_devices.rigs import rig_with

RUN = ("dynamic", "run", "--height", "215", "--speed", "3.249", "--repeats", "1")


@pytest.fixture
def marked_rig(tmp_path: Path, monkeypatch) -> Path:
    """A rig whose motor driver leaves a mark when it is executed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "theirs").mkdir()
    rig = rig_with(
        tmp_path / "theirs",
        "motor",
        change=("following_error_deg = 20.0", "following_error_deg = 3.0"),
    )
    rig.write_text(
        rig.read_text().replace(
            "following_error_deg_s_per_rad = 8.0", "following_error_deg_s_per_rad = 1.0"
        )
    )
    driver = tmp_path / "theirs" / "our_motor.py"
    driver.write_text(
        f"{driver.read_text()}\nfrom pathlib import "
        f"Path\n\nPath({str(tmp_path / 'executed')!r}).touch()\n"
    )
    return rig


def has_run(folder: Path) -> bool:
    mark = folder / "executed"
    found = mark.exists()
    mark.unlink(missing_ok=True)
    return found


def test_a_recording_from_elsewhere_does_not_choose_what_is_executed(
    marked_rig, tmp_path, monkeypatch, capsys
):
    said = typed(monkeypatch, capsys, *RUN, "--rig", marked_rig)
    assert said.exit_code == 3, said.err
    (folder,) = Path("runs").iterdir()
    assert has_run(tmp_path)
    again = ("resume", folder, "--after-trip", "--dry-run")
    assert typed(monkeypatch, capsys, *again).exit_code == 0, "it drove a run on this computer"
    shutil.rmtree(tmp_path / "config")
    driver = marked_rig.parent / "our_motor.py"
    driver.write_text(driver.read_text() + "# another text, which this process has not loaded\n")
    has_run(tmp_path)
    said = typed(monkeypatch, capsys, *again)
    assert said.exit_code == 2
    assert f"would execute {driver}, which never drove a run on this computer" in said.err
    assert not has_run(tmp_path)


@pytest.mark.parametrize(
    "words",
    [
        (*RUN, "--dry-run"),
        ("plan", "table2"),
        ("predict", "--height", "215", "--speed", "2.4"),
        ("doctor", "--rig", "twin"),
        ("strip",),
    ],
    ids=lambda words: words[0],
)
def test_a_rig_file_in_the_current_folder_executes_nothing_by_its_bare_name(
    marked_rig, tmp_path, monkeypatch, capsys, words
):
    shutil.copytree(marked_rig.parent, "calibration")
    shutil.move(f"calibration/{marked_rig.name}", "calibration/twin.toml")
    said = typed(monkeypatch, capsys, *words)
    assert not has_run(tmp_path)
    assert said.exit_code == 2
    assert "calibration/twin.toml: would execute" in said.err
    assert "then give --rig calibration/twin.toml" in said.err


def test_a_path_on_the_command_line_is_a_choice(marked_rig, tmp_path, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, *RUN, "--dry-run", "--rig", marked_rig)
    assert said.exit_code == 0, said.err
    assert has_run(tmp_path)

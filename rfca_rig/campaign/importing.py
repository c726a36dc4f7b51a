"""Imports a campaign folder as a recording on disk; copies the campaign of a pendulum unchanged."""

import shutil
from collections.abc import Callable
from pathlib import Path

from rfca_rig.campaign.opening import RECORDING_NAME
from rfca_rig.campaign.pendulum import PendulumCampaign, read_pendulum_campaign, run_files
from rfca_rig.campaign.pendulum_layout import FILE_NAME as PENDULUM
from rfca_rig.campaign.plausibility import refuse_slips
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput, RigError
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording.atomic import make_folder_atomically
from rfca_rig.recording.store import write_recording


def import_campaign(folder: Path, out_folder: Path, report_progress: ProgressCount = ignore_progress, as_is: bool = False) -> Path:
    """Read the campaign in `folder` and write `out_folder`/run.h5, all or nothing. Returns the file's path.

    `report_progress` receives how many of its files have been read. Raises BadInput, one line, where the campaign cannot be used,
    `out_folder` exists, or a value is probably in another unit, unless it is to be taken `as_is`. Raises RigError where the disk refuses.
    """
    _check_new(out_folder)
    recording = read_campaign(folder, report_progress)
    if not as_is:
        refuse_slips(folder, recording)
    _make(out_folder, lambda partial: write_recording(recording, partial / RECORDING_NAME))
    return out_folder / RECORDING_NAME


def import_pendulum(folder: Path, out_folder: Path) -> PendulumCampaign:
    """Check the campaign of a pendulum in `folder` and copy it to `out_folder`, all or nothing: description, runs, licences.

    Every command reads such a folder directly, so the copy has the same form. Raises BadInput, one line, where the campaign cannot be used
    or `out_folder` exists. Raises RigError where the disk refuses.
    """
    _check_new(out_folder)
    campaign = read_pendulum_campaign(folder)
    # Licence and read-me files stay with the data.
    licences = [path.name for path in folder.iterdir() if path.is_file() and path.name.upper().startswith(("LICEN", "README"))]
    names = [PENDULUM, *run_files(folder), *sorted(licences)]

    def copy(partial: Path) -> None:
        for name in names:
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / name, partial / name)

    _make(out_folder, copy)
    return campaign


def _check_new(out_folder: Path) -> None:
    if out_folder.exists():
        raise BadInput(f"{out_folder}: is there already; name a folder that does not exist yet, or take this one away")


def _make(out_folder: Path, write: Callable[[Path], object]) -> None:
    try:
        make_folder_atomically(out_folder, write)
    except (FileExistsError, NotADirectoryError):
        raise BadInput(f"{out_folder}: cannot be made: there is a file in its way; name another folder with --out") from None
    except OSError as error:
        raise RigError(f"{out_folder}: cannot be made: {error.strerror}") from None

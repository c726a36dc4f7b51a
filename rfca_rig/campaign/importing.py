"""Turns a campaign folder into a recording on disk."""

from pathlib import Path

from rfca_rig.campaign.opening import RECORDING_NAME
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput, RigError
from rfca_rig.progress import Watcher, unwatched
from rfca_rig.recording.atomic import make_folder_atomically
from rfca_rig.recording.store import write_recording


def import_campaign(folder: Path, out_folder: Path, told: Watcher = unwatched) -> Path:
    """Reads the campaign in `folder` and writes `out_folder`/run.h5, all or nothing. Returns the file's path.
    `told` hears how many of its files have been read.

    Raises BadInput, one line, where the campaign cannot be used or `out_folder` is there already, RigError when the disk refuses.
    """
    if out_folder.exists():
        raise BadInput(f"{out_folder}: is there already; name a folder that does not exist yet, or take this one away")
    recording = read_campaign(folder, told)
    try:
        make_folder_atomically(out_folder, lambda partial: write_recording(recording, partial / RECORDING_NAME))
    except (FileExistsError, NotADirectoryError):
        raise BadInput(f"{out_folder}: cannot be made: there is a file in its way; name another folder with --out") from None
    except OSError as error:
        raise RigError(f"{out_folder}: cannot be made: {error.strerror}") from None
    return out_folder / RECORDING_NAME

"""Opens any kind of recording: a campaign, an imported campaign, a run, or a recording file;
imports a campaign as a recording.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import Experiment, read_experiment
from rfca_rig.campaign.pendulum import FILE_NAME as PENDULUM
from rfca_rig.campaign.pendulum import read_pendulum, run_files
from rfca_rig.campaign.plausibility import refuse_slips
from rfca_rig.campaign.reading import ALWAYS_MEASURED, MOST_DISORDER_S, read_campaign
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import BadInput, RigError
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording import run_folder
from rfca_rig.recording.atomic import make_folder_atomically
from rfca_rig.recording.layout import CAMPAIGN, EXPERIMENT, refuse_links
from rfca_rig.recording.model import Recording, StaticStage, Stream
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.recording.run_folder import partial_of, read_partial
from rfca_rig.recording.store import read_recording, write_recording
from rfca_rig.suggestions import not_there

RECORDING_NAME = "run.h5"
# Fewer give no speed and no valley.
FEWEST_SAMPLES = 3
# A turn at 0.01 rad/s, the least speed of a plan, takes 630 s.
LONGEST_STROKE_S = 3600.0
# Far above any unit of any quantity; squares of it are still numbers.
MOST_VALUE = 1e100


def experiment_among(paths: Sequence[Path]) -> Path | None:
    """The recordings of a mechanism or a pendulum in `paths`, None where there are none.

    Raises BadInput where they are not the only path, because their model differs from that of all
    other paths.
    """
    for path in paths:
        for description in (EXPERIMENT, PENDULUM):
            if not (path / description).is_file():
                continue
            if len(paths) > 1:
                raise BadInput(
                    f"{path}: holds {description}, which has a model of its own; give it alone"
                )
            return path
    return None


def open_experiment(
    folder: Path, allow_outside: bool = False, model: Path | None = None
) -> Experiment:
    """The recordings of a mechanism or a pendulum in `folder`.

    Parameters
    ----------
    folder
        With experiment.toml or pendulum.toml.
    allow_outside
        Take links that lead out of the folder, and files of the model anywhere.
    model
        A model file that takes the place of the folder's own model; of a pendulum, one that ends
        with .toml gives its links.

    Raises
    ------
    BadInput
        One line, for the first fault.
    """
    is_pendulum = (folder / PENDULUM).is_file()
    if is_pendulum and (model is None or model.suffix == ".toml"):
        return read_pendulum(folder, allow_outside, model)
    if is_pendulum:
        experiment = read_pendulum(folder, allow_outside)
    else:
        experiment = read_experiment(folder, allow_outside)
    if model is None:
        return experiment
    # A model file for MuJoCo, also in place of what pendulum.toml describes.
    return replace(experiment, model=model, mjcf="")


def open_recordings(
    paths: Sequence[Path], as_is: bool = True, allow_outside: bool = False
) -> list[Recording]:
    """Open the recordings at `paths`, in their order. Values of a campaign that are probably in
    another unit are taken `as_is` or refused.

    Each path is a folder with campaign.toml, a folder with run.h5 (also of a run that a crash left
    unfinished), or an .h5 file. Strokes of a run are numbered in the order in which it made them.
    Of a campaign, links to files elsewhere are refused, unless `allow_outside`. Raises BadInput for
    anything else.
    """
    recordings = []
    for path in paths:
        recording = _open(path, allow_outside)
        # What was imported was checked then.
        if not as_is and not (path / RECORDING_NAME).is_file() and (path / CAMPAIGN).is_file():
            refuse_slips(path, recording)
        _check_strokes(path, recording)
        recordings.append(recording.with_order())
    return recordings


def _check_strokes(path: Path, recording: Recording) -> None:
    """Raises BadInput for a stroke that no analysis can use, whatever it is."""
    for number, stroke in enumerate(recording.strokes, start=1):
        for name, stream in stroke.streams.items():
            where = f"{path}: stroke {number}, {name}"
            t_s = stream.t_s
            if len(t_s) < FEWEST_SAMPLES:
                raise BadInput(
                    f"{where}: {len(t_s)} samples, where {FEWEST_SAMPLES} are the fewest"
                )
            if not 0.0 < t_s[-1] - t_s[0] < LONGEST_STROKE_S:
                span = f"goes from {t_s[0]:g} s to {t_s[-1]:g} s"
                raise BadInput(
                    f"{where}: time {span}, where it should run forwards for "
                    f"{LONGEST_STROKE_S:g} s at most"
                )
            _check_stream(where, stream)


def _check_stream(where: str, stream: Stream) -> None:
    # Since the latest record before: a series of small steps backwards is no network's disorder.
    behind_s = (np.maximum.accumulate(stream.t_s) - stream.t_s).max(initial=0.0)
    if behind_s > MOST_DISORDER_S:
        raise BadInput(
            f"{where}: time runs backwards, by up to {behind_s:g} s, where "
            f"{MOST_DISORDER_S:g} s are the most"
        )
    for column, values in ((key, samples.values) for key, samples in stream.columns.items()):
        # NaN stands for a value that a device did not give.
        if (np.abs(values) > MOST_VALUE).any():
            raise BadInput(
                f"{where}: {column} reaches {np.nanmax(np.abs(values)):g}, which no sensor gives"
            )


def open_unsealed(path: Path) -> Recording:
    """Open a file without a seal, of which no checksum shows whether it is as a run wrote it: every
    value and the model are checked.

    Raises BadInput for what no run writes.
    """
    (recording,) = open_with_nominal_model([path])
    stages = [
        (f"stroke {number}", stroke.streams)
        for number, stroke in enumerate(recording.strokes, start=1)
    ]
    stages += [
        (f"raw stage {number}", stage.streams)
        for number, stage in enumerate(recording.raw, start=1)
    ]
    for stage, streams in stages:
        for name, stream in streams.items():
            where = f"{path}: {stage}, {name}"
            _check_stream(where, stream)
            for column in ALWAYS_MEASURED:
                if (
                    column in stream.columns
                    and not np.isfinite(stream.columns[column].values).all()
                ):
                    raise BadInput(
                        f"{where}: {column} holds a value that is no number; a run always "
                        "measures it"
                    )
    return recording


def open_with_nominal_model(
    paths: Sequence[Path], as_is: bool = True, allow_outside: bool = False
) -> list[Recording]:
    """The same where the nominal model is needed: raises BadInput, naming the path, where its
    values form no valid model.

    Recordings with static stages alone need no nominal model.
    """
    recordings = open_recordings(paths, as_is, allow_outside)
    for path, recording in zip(paths, recordings, strict=True):
        if recording.nominal or recording.strokes:
            try:
                nominal_model(recording.nominal)
            except BadInput as error:
                raise BadInput(f"{path}: {error}") from None
    return recordings


def _open(path: Path, allow_outside: bool) -> Recording:
    if path.is_dir():
        refuse_links(path)
        # The finished file takes precedence over everything beside it.
        recording = path / RECORDING_NAME
        if recording.is_file():
            return read_recording(recording)
        if (path / CAMPAIGN).is_file():
            return read_campaign(path, allow_outside=allow_outside)
        if run_folder.is_run(path):
            return run_folder.read_stages(path)
        if partial_of(recording).is_dir():
            return read_partial(recording)
        if (path / PENDULUM).is_file():
            # These forms are known, but this command has no use for them; the message names the
            # commands that have.
            raise BadInput(
                f"{path}: is a campaign of a pendulum, which this command does not take; "
                "import, report, fit and diagnose do"
            )
        if (path / EXPERIMENT).is_file():
            raise BadInput(
                f"{path}: holds recordings of a mechanism, which this command does not "
                "take; check, report, fit and diagnose do"
            )
        raise BadInput(
            f"{path}: holds neither {CAMPAIGN} nor {RECORDING_NAME}, so it is no campaign "
            "and no run"
        )
    if not path.exists():
        raise BadInput(not_there(path))
    if path.suffix != ".h5":
        raise BadInput(
            f"{path}: is not a recording; give a folder with {CAMPAIGN} or "
            f"{RECORDING_NAME}, or an .h5 file"
        )
    return read_recording(path)


def import_campaign(
    folder: Path,
    out_folder: Path,
    report_progress: ProgressCount = ignore_progress,
    as_is: bool = False,
    allow_outside: bool = False,
) -> Path:
    """Read the campaign in `folder` and write `out_folder`/run.h5, all or nothing. Returns the
    file's path.

    `report_progress` receives how many of its files have been read. Raises BadInput, one line,
    where the campaign cannot be used, `out_folder` exists, or a value is probably in another unit,
    unless it is to be taken `as_is`. Raises RigError where the disk refuses.
    """
    _check_new(out_folder)
    recording = read_campaign(folder, report_progress, allow_outside)
    if not as_is:
        refuse_slips(folder, recording)
    pictures = list_pictures(recording.static)
    if not allow_outside:
        refuse_outside((folder / name for name in pictures), [folder])

    def write(partial: Path) -> None:
        write_recording(recording, partial / RECORDING_NAME)
        copy_pictures(pictures, folder, partial)

    _make(out_folder, write)
    return out_folder / RECORDING_NAME


def list_pictures(stages: Sequence[StaticStage]) -> list[str]:
    """Photos and overlays of static stages, relative to the folder of their recording."""
    pictures = [name for stage in stages for name in (stage.photo, stage.overlay) if name]
    return list(dict.fromkeys(pictures))


def copy_pictures(pictures: Sequence[str], source: Path, target: Path) -> None:
    """Copy the pictures that are there; a report says of the others that they are gone."""
    for name in pictures:
        if (source / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, target / name)


def import_pendulum(folder: Path, out_folder: Path, allow_outside: bool = False) -> Experiment:
    """Check the campaign of a pendulum in `folder` and copy it to `out_folder`, all or nothing:
    description, runs, licences.

    Every command reads such a folder directly, so the copy has the same form. Raises BadInput, one
    line, where the campaign cannot be used or `out_folder` exists. Raises RigError where the disk
    refuses.
    """
    _check_new(out_folder)
    campaign = read_pendulum(folder, allow_outside)
    # Licence and read-me files stay with the data.
    licences = [
        path.name
        for path in folder.iterdir()
        if path.is_file() and path.name.upper().startswith(("LICEN", "README"))
    ]
    names = [PENDULUM, *run_files(folder), *sorted(licences)]
    if not allow_outside:
        refuse_outside((folder / name for name in names), [folder])

    def copy(partial: Path) -> None:
        for name in names:
            (partial / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(folder / name, partial / name)

    _make(out_folder, copy)
    return campaign


def _check_new(out_folder: Path) -> None:
    if out_folder.exists():
        raise BadInput(
            f"{out_folder}: is there already; name a folder that does not exist yet, or "
            "take this one away"
        )


def _make(out_folder: Path, write: Callable[[Path], object]) -> None:
    try:
        make_folder_atomically(out_folder, write)
    except (FileExistsError, NotADirectoryError):
        raise BadInput(
            f"{out_folder}: cannot be made: there is a file in its way; name another "
            "folder with --out"
        ) from None
    except OSError as error:
        raise RigError(f"{out_folder}: cannot be made: {error.strerror}") from None

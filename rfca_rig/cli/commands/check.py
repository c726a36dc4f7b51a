"""rfca-rig check, recover and schema: recordings on disk, and the form of files that people
write.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from rfca_rig.cli.options import AllowOutside, Json
from rfca_rig.cli.since_reference import (
    Gate,
    SinceReference,
    compare_with_set_reference,
    pass_gate,
)
from rfca_rig.cli.terminal import echo
from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    from rfca_rig.progress import ProgressCount
    from rfca_rig.recording.model import Recording


def check(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH",
            help=(
                "The folder of a run, one with experiment.toml, pendulum.toml or campaign.toml; a "
                "rig file or a protocol."
            ),
        ),
    ],
    allow_outside: AllowOutside = False,
    gate: Gate = False,
    as_json: Json = False,
) -> None:
    """Check a run on disk: every file by its hash, every stage by its counts, a line each. Exit
    code 2 where one is damaged. Where its rig has a reference (reference set): what has changed.

    Of a campaign from elsewhere (campaign.toml): values that are probably in another unit or of the
    other sign.

    Of recordings of a mechanism (experiment.toml, pendulum.toml): what can be used, how well the
    nominal model predicts, signs and units that are probably wrong. Exit code 2 where something
    cannot be used.

    Of a rig file or a protocol: whether it can be read, and which command checks it further.

    Example: rfca-rig check runs/REAL-flapping-001
    """
    from rfca_rig.campaign.opening import experiment_among
    from rfca_rig.recording.layout import CAMPAIGN, EXPERIMENT, PENDULUM

    # A folder is described by the file in it; either names the recordings.
    if path.name in (CAMPAIGN, EXPERIMENT, PENDULUM) and path.is_file():
        folder = path.parent
    else:
        folder = path
    if folder.is_file():
        _check_file(folder, as_json)
    elif (folder / CAMPAIGN).is_file():
        _check_campaign(folder, allow_outside, gate, as_json)
    elif experiment_among([folder]) is not None:
        _check_experiment(folder, allow_outside, gate, as_json)
    else:
        _check_run(folder, gate, as_json)


def _check_file(path: Path, as_json: bool) -> None:
    """Checks a rig file or a protocol, and names the command that goes further. Raises BadInput
    for any other file, with what reads it.
    """
    from rfca_rig.description.protocol_file import PROTOCOLS
    from rfca_rig.toml import read_data

    if path.suffix == ".h5":
        raise BadInput(
            f"{path}: is one file of a run; rfca-rig check {path.parent} checks all of them"
        )
    if path.suffix != ".toml":
        raise BadInput(
            f"{path}: is a file, and no .toml; give the folder of a run, a rig file or a protocol"
        )
    data = read_data(path)
    if isinstance(data.get("rig"), dict):
        kind = "rig"
        description, usual = _check_rig(path)
        further = f"doctor --rig {path}"
    elif isinstance(experiment := data.get("experiment"), str) and experiment in PROTOCOLS:
        file = PROTOCOLS[experiment](path)
        kind = "protocol"
        description = f"{experiment} protocol, {file.title}"
        usual = 0
        further = f"plan {path}"
    else:
        readers = {
            "vary": f"sweep {path}",
            "samples": f"sweep {path}",
            "leg": f"predict --model {path}",
        }
        reader = next((command for key, command in readers.items() if key in data), None)
        if reader:
            hint = f"rfca-rig {reader} reads it"
        else:
            hint = "a rig file has [rig], a protocol has experiment"
        raise BadInput(f"{path}: is neither a rig file nor a protocol; {hint}")
    if as_json:
        echo(
            json.dumps(
                {"file": str(path), "kind": kind, "found": description, "usual_values": usual},
                indent=1,
            )
        )
        return
    echo(f"ok      {path}: {description}")
    if usual:
        echo(f"{usual} lines hold a usual value; compare them with your rig", err=True)
    echo(f"next: rfca-rig {further}", err=True)


def _check_rig(path: Path) -> tuple[str, int]:
    """What a rig file describes, and how many of its lines hold a value that nobody entered."""
    from rfca_rig.cli.paths import check_trusted
    from rfca_rig.description.rig_draft import USUAL
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.toml import read_text

    # Who checks a file from elsewhere does not expect that its code runs.
    check_trusted(path, f"rfca-rig doctor --rig {path}")
    rig = read_rig(path)
    usual = sum(line.rstrip().endswith(USUAL) for line in read_text(path).splitlines())
    camera = "a camera"
    if rig.camera is None:
        camera = "no camera"
    devices = f"drive {rig.motor.device}, force sensor {rig.force_sensor.device}, {camera}"
    return f"{rig.source} rig file, {rig.rig.title}; {devices}", usual


def _check_run(run: Path, is_gate: bool, as_json: bool) -> None:
    """Checks every file of a run, and where all are sound, compares it with its reference."""
    from rfca_rig.cli.progress import progress
    from rfca_rig.recording.checking import check_run, describe_damage

    findings = []
    with progress(as_json) as bars:
        done_MB = 0.0
        total_MB = _size_MB(run)
        for finding in check_run(run):
            done_MB += _size_MB(run / finding.file)
            bars.report("checking, MB", round(done_MB), max(1, round(total_MB)))
            findings.append(finding)
            # Printed as it is found: a long run takes minutes, and the first damage should show at
            # once.
            if not as_json:
                state = "DAMAGED"
                if finding.is_sound:
                    state = "ok     "
                echo(f"{state} {finding.file}: {finding.words}")
    is_sound = all(finding.is_sound for finding in findings)
    answer = None
    if is_sound:
        answer = compare_with_set_reference(run, is_gate, as_json)
    if as_json:
        rows = [
            {"file": finding.file, "sound": finding.is_sound, "found": finding.words}
            for finding in findings
        ]
        _print_json({"run": str(run), "files": rows}, answer)
    if not is_sound:
        raise BadInput(describe_damage(run, findings))
    _say_since_reference(answer, is_gate, as_json)


def _print_json(found: dict[str, Any], answer: SinceReference | None) -> None:
    """Print what was found, with the comparison with the reference where there is one."""
    if answer is not None:
        found = {**found, "since_reference": answer.plain()}
    echo(json.dumps(found, indent=1))


def _say_since_reference(answer: SinceReference | None, is_gate: bool, as_json: bool) -> None:
    """Print what has changed since the reference. Raises Changed for a gate."""
    if answer is not None and not as_json:
        echo(answer.line(), err=True)
    pass_gate(answer, is_gate)


def _check_campaign(folder: Path, allow_outside: bool, is_gate: bool, as_json: bool) -> None:
    """A campaign from elsewhere: whether it can be read, whether its values are plausible beside
    each other, and how it compares with its reference.
    """
    from rfca_rig.campaign.leg_draft import count_unchecked
    from rfca_rig.campaign.plausibility import find_slips
    from rfca_rig.campaign.reading import read_campaign
    from rfca_rig.recording.layout import CAMPAIGN
    from rfca_rig.toml import read_text

    recording = read_campaign(folder, allow_outside=allow_outside)
    slips = find_slips(recording)
    guesses, usual_values = count_unchecked(read_text(folder / CAMPAIGN))
    answer = None
    if not slips:
        answer = compare_with_set_reference(folder, is_gate, as_json)
    if as_json:
        rows = [{"where": slip.where, "found": slip.words} for slip in slips]
        unchecked = {"guesses": guesses, "usual_values": usual_values}
        _print_json({"campaign": str(folder), "slips": rows, **unchecked}, answer)
    else:
        for slip in slips:
            echo(f"WARNING {slip.where}: {slip.words}")
    if slips:
        raise BadInput(
            f"{folder}: {len(slips)} value{'s' * (len(slips) > 1)} probably in another "
            "unit; rfca-rig import --as-is takes them"
        )
    if not as_json:
        echo(
            (
                f"{folder}: {len(recording.strokes)} strokes and {len(recording.static)} "
                "static stages, values plausible"
            ),
            err=True,
        )
        if guesses or usual_values:
            echo(
                f"{guesses} guesses and {usual_values} usual values are marked in "
                f"{folder / CAMPAIGN}; compare them with your rig, and remove the marks",
                err=True,
            )
    _say_since_reference(answer, is_gate, as_json)


def _check_experiment(folder: Path, allow_outside: bool, is_gate: bool, as_json: bool) -> None:
    """Checks recordings of a mechanism, with its model, and where they can be used, compares them
    with their reference.
    """
    from rfca_rig.cli.terminal import print_lines
    from rfca_rig.diagnosis.mechanisms.check import check_experiment

    # A refusal is raised at the end, so that the findings before it are printed, also as JSON.
    rows = []
    refused = None
    try:
        for line in check_experiment(folder, allow_outside):
            rows.append(
                {
                    "about": line.about,
                    "name": line.name,
                    "warning": line.is_warning,
                    "found": line.words,
                    "values": dict(line.values),
                }
            )
            if not as_json:
                state = "ok     "
                if line.is_warning:
                    state = "WARNING"
                print_lines([f"{state} {line.about} {line.name}: {line.words}"], indent=" " * 8)
    except BadInput as error:
        refused = error
    answer = None
    if refused is None:
        answer = compare_with_set_reference(folder, is_gate, as_json)
    if as_json:
        found = {"experiment": str(folder), "usable": refused is None, "lines": rows}
        if refused is not None:
            found["refused"] = str(refused)
        _print_json(found, answer)
    if refused is not None:
        raise refused
    if not as_json:
        warnings = sum(bool(row["warning"]) for row in rows)
        echo(f"{folder}: can be used; {warnings} warning{'' if warnings == 1 else 's'}", err=True)
    _say_since_reference(answer, is_gate, as_json)


def _size_MB(path: Path) -> float:
    """Size in MB of a file, or of all files in a folder."""
    files: Iterable[Path] = [path]
    if path.is_dir():
        files = path.rglob("*")
    return sum(file.stat().st_size for file in files if file.is_file()) / 1e6


FileKind = Literal["rig", "protocol", "experiment", "campaign", "sweep", "tolerances"]


def schema(
    kind: Annotated[
        FileKind, typer.Argument(metavar="KIND", help=f"The file: {', '.join(get_args(FileKind))}.")
    ],
) -> None:
    """Print the JSON schema of a file that you write, with which an editor completes and checks its
    keys.

    Editors with Taplo read it after a first line #:schema rig.json in the TOML file.

    Example: rfca-rig schema rig > rig.json
    """
    import json

    from pydantic import TypeAdapter
    from pydantic.json_schema import GenerateJsonSchema

    from rfca_rig.campaign.layout import CampaignFile, ExperimentFile
    from rfca_rig.description.protocol_file import DynamicFile, FatigueFile, StaticFile
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.description.tolerances_file import TolerancesFile
    from rfca_rig.sweep.sweep_file import SweepFile

    models: dict[FileKind, Any] = {
        "rig": RigFile,
        "protocol": DynamicFile | StaticFile | FatigueFile,
        "experiment": ExperimentFile,
        "campaign": CampaignFile,
        "sweep": SweepFile,
        "tolerances": TolerancesFile,
    }
    head = {"$schema": GenerateJsonSchema.schema_dialect, "title": f"rfca-rig: {kind} file"}
    echo(json.dumps(head | TypeAdapter(models[kind]).json_schema() | head, indent=1))


def recover(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN", help="The folder of the run, or the run.h5 that it should have become."
        ),
    ],
    as_json: Json = False,
) -> None:
    """Make a whole recording of a run that a crash or a power cut ended, the stage in progress
    included. Not while it still goes on.

    Also makes run.h5 again from the files of the stages, where it is missing or damaged.

    Example: rfca-rig recover runs/REAL-flapping-001
    """
    import json

    from rfca_rig.campaign.opening import RECORDING_NAME
    from rfca_rig.cli.progress import progress
    from rfca_rig.recording.checking import is_run_folder
    from rfca_rig.recording.store import summarize

    path = run
    if run.suffix != ".h5":
        path = run / RECORDING_NAME
    with progress(as_json) as bars:
        if is_run_folder(path.parent):
            recording = _recover_run(path.parent, bars.counting("stages"))
        else:
            recording = _older(path)
    summary = summarize(path, thorough=False)
    if as_json:
        counted = {
            "strokes": summary.strokes,
            "static_stages": summary.static,
            "raw_stages": summary.raw,
        }
        echo(
            json.dumps(
                {"source": recording.source, "run": str(path), "title": recording.title, **counted},
                indent=1,
            )
        )
        return
    cut_short = "".join(f", {label} until it was cut short" for label in summary.cut_short)
    counted_text = f"{summary.strokes} strokes and {summary.static} static stages{cut_short}"
    echo(
        (
            f"{recording.source} recovered {counted_text} in {path}; next: rfca-rig report "
            f"{path} --out report"
        ),
        err=True,
    )


def _recover_run(folder: Path, watcher: "ProgressCount") -> "Recording":
    """Recovers the run; returns it without its samples."""
    from rfca_rig.bench.stage_photos import read_missing_photos
    from rfca_rig.recording import run_folder
    from rfca_rig.recording.checking import (
        can_recover,
        check_run,
        describe_damage,
        needs_no_recovery,
    )
    from rfca_rig.recording.run_text import INTERRUPTED, Ending, read_ending, write_ending

    # Once: it reads every file of the run.
    findings = list(check_run(folder))
    if needs_no_recovery(folder, findings):
        raise BadInput(f"{folder}: is whole; there is nothing to recover")
    if not can_recover(folder, findings):
        raise BadInput(describe_damage(folder, findings))
    # First the stage in progress: it belongs into run.h5 like the others.
    run_folder.close_journals(folder)
    # A run that ended normally, and only lost run.h5, keeps what its end says.
    if read_ending(folder) is None:
        recording = run_folder.read_without_samples(folder)
        with_photos = read_missing_photos(recording, folder)
        # Only the texts that reading the photos added; the end file repeats nothing of the header.
        added = {
            name: text
            for name, text in with_photos.provenance.items()
            if name != "events" and recording.provenance.get(name) != text
        }
        interrupted = {INTERRUPTED: recording.provenance[INTERRUPTED]}
        write_ending(folder, Ending({**interrupted, **added}, with_photos.static))
    run_folder.build_recording(folder, watcher)
    return run_folder.read_without_samples(folder)


def _older(path: Path) -> "Recording":
    """Recovers a run of an older version, which left a folder beside the file that it should
    have become.
    """
    from rfca_rig.bench.stage_photos import read_missing_photos
    from rfca_rig.recording.run_folder import partial_of, recover_partial
    from rfca_rig.recording.store import read_recording, write_recording

    if not partial_of(path).is_dir():
        raise BadInput(_nothing_to_recover(path))
    recording = read_recording(recover_partial(path))
    with_photos = read_missing_photos(recording, path.parent)
    if with_photos is not recording:
        write_recording(with_photos, path)
    return with_photos


def _nothing_to_recover(path: Path) -> str:
    """The reason, for a file or the folder that it should be in, without a run's files beside
    it.
    """
    from rfca_rig.recording.store import summarize
    from rfca_rig.suggestions import not_there

    if not path.is_file():
        if path.parent.is_dir():
            return f"{path.parent}: holds no interrupted run; rfca-rig runs lists what was recorded"
        return not_there(path.parent)
    try:
        summarize(path, thorough=False)
    except BadInput as error:
        return f"{error}; and there are no stage files beside it to make it again from"
    return f"{path}: is whole, and there is no interrupted run beside it to recover"

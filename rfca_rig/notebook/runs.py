"""The runs below a folder as a table of all that is known about them."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rfca_rig.campaign.experiment import measure_seconds
from rfca_rig.logbook.entry import Entry
from rfca_rig.logbook.listing import list_runs
from rfca_rig.logbook.reading import read_provenance
from rfca_rig.notebook.recordings import make_frame

if TYPE_CHECKING:
    import pandas

# Longer texts are files (rig, protocol, plan), which `rr.open(path).provenance` has.
MOST_LETTERS = 200


def runs(folder: str | Path = "runs") -> "pandas.DataFrame":
    """A row per run below a folder, newest first, to be filtered as any table of pandas.

    Columns are those of `rfca-rig runs --json`, heights and speeds as tuples, the verdict in
    `verdict`, `effects` and `probability`; and the short texts of the run's provenance, such as
    versions, devices, operator, sample and seed. Where a run has none of these, they are empty.

    Parameters
    ----------
    folder
        The folder that the runs lie below.

    Raises
    ------
    BadInput
        Where there is no such folder.
    """
    below = Path(folder)
    rows = [
        describe_run(below / entry.folder, entry)
        for entry in list_runs(below, measure_s=measure_seconds)
    ]
    return make_frame(rows, ("run", "began", "title", "source", "kind", "ended"))


def describe_run(path: Path, entry: Entry) -> dict[str, Any]:
    """The row of the run in the folder `path`, of which the logbook has `entry`."""
    return {**_describe(path, entry), **_select_short(path, entry)}


def _describe(path: Path, entry: Entry) -> dict[str, Any]:
    described = entry.plain()
    for name in ("folder", "began_s", "conditions", "verdict"):
        del described[name]
    verdict = entry.verdict
    heights_mm = {condition.height_mm for condition in entry.conditions}
    speeds_rad_s = {condition.speed_rad_s for condition in entry.conditions} - {None}
    return {
        "run": str(path),
        "began": datetime.fromtimestamp(entry.began_s, UTC),
        **described,
        "heights_mm": tuple(sorted(heights_mm)),
        "speeds_rad_s": tuple(sorted(speed for speed in speeds_rad_s if speed is not None)),
        "verdict": "" if verdict is None else verdict.words,
        "effects": () if verdict is None else verdict.effects,
        "probability": None if verdict is None else verdict.probability,
    }


def _select_short(path: Path, entry: Entry) -> dict[str, str]:
    # A damaged run is listed as such; its header may be what is damaged.
    if entry.ended == "damaged":
        return {}
    provenance = read_provenance(path)
    return {name: text for name, text in provenance.items() if len(text) <= MOST_LETTERS}

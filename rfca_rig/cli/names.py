"""Names that can be typed on the command line, found without loading anything heavy: for completion and suggestions."""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

from rfca_rig.cli.paths import PACKAGE, folders_of
from rfca_rig.logbook import entry
from rfca_rig.logbook.query import VERDICTS as ANY_VERDICT
from rfca_rig.trip_codes import Trip

# Copies of names that other packages define: importing those would take too long for a completion.
FIT_PARAMETERS = (
    "k0",
    "k2",
    "hinge_damping",
    "mass",
    "link_radius",
    "friction",
    "contact_stiffness",
    "contact_damping",
    "presliding",
    "friction_lever",
    "friction_rise",
    "leaving_damping",
    "tangential_damping",
    "below_shaft",
    "ramp",
    "start_angle",
    "height",
)
MECHANISM_EFFECTS = (
    "joint_friction",
    "joint_friction_of_one",
    "joint_stribeck",
    "joint_hysteresis",
    "joint_load_friction",
    "joint_load_friction_of_one",
    "gear_compliance",
    "gear_compliance_of_one",
    "gear_backlash",
    "gear_backlash_of_one",
    "joint_damping",
    "joint_damping_of_one",
    "joint_drag",
    "joint_drag_of_one",
    "joint_inertia",
    "joint_inertia_of_one",
    "joint_spring",
    "joint_spring_of_one",
    "joint_stop",
    "torque_scale",
    "torque_scale_of_one",
    "torque_delay",
    "torque_lag",
    "torque_saturation",
    "torque_dead_band",
    "torque_falls_with_speed",
    "clock_rate",
    "speed_lag",
    "sensor_gain",
    "sensor_gain_of_one",
    "sensor_crosstalk",
    "sensor_drift",
    "sensor_lag",
    "clock_offset",
    "contact_stiffness",
    "contact_damping",
    "contact_friction",
    "contact_power",
    "gravity_tilt",
    "prescribed_offset",
    "prescribed_angle_offset",
    "added_mass",
    "centre_of_mass",
)
CASE_KINDS = (
    "nothing missing",
    "nothing missing, model error",
    "one effect",
    "two effects",
    "stranger",
    "right family, wrong law",
    "poor data",
    "wrong metadata",
    "approximate law",
    "three effects",
    "pendulum, nothing missing",
    "pendulum, one effect",
    "pendulum, two effects",
    "pendulum, stranger",
)
PHASES = ("rest", "free", "touchdown", "loading", "release", "rebound")
FILE_KINDS = ("rig", "protocol", "experiment", "campaign", "sweep")
RUN_KINDS, SOURCES = entry.KINDS, entry.SOURCES
RUN_ENDINGS = tuple(word.replace(" ", "-") for word in entry.ENDINGS)
VERDICTS = tuple(word.replace(" ", "-") for word in ANY_VERDICT)
TRIP_CODES = tuple(code.value for code in Trip)
RECORDED = ("run.json", "run.h5", "campaign.toml", "pendulum.toml", "experiment.toml")
MAX_FOLDERS = 50
EFFECT_ID = re.compile(r'^ +id="(\w+)"', re.MULTILINE)


def effect_names() -> list[str]:
    """Effects of the package, by their ids in its files, and of the lab's own folder, where an effect's file has its name."""
    text = "".join(file.read_text(encoding="utf-8") for file in (PACKAGE / "model" / "effects").glob("*.py"))
    return sorted({*EFFECT_ID.findall(text), *_stems(filter(None, (os.environ.get("RFCA_RIG_EFFECTS"),)), "*.py")})


def file_names(kind: str) -> list[str]:
    """Protocols, sweeps or rigs ("calibration") that can be named without a path."""
    return _stems(folders_of(kind), "*.toml")


def rig_names() -> list[str]:
    """Rig files; camera files lie in the same folder and are left out."""
    files = {file.stem: file for folder in folders_of("calibration") for file in Path(folder).glob("*.toml")}
    return sorted(name for name, file in files.items() if "\n[rig]" in file.read_text(encoding="utf-8", errors="replace"))


def list_recorded_folders(begun: str) -> list[str]:
    """Folders of runs and campaigns whose path begins with `begun`, newest first; those in runs/ where nothing is typed yet."""
    parent, slash, _ = begun.rpartition("/")
    places = [parent or "/"] if slash else [".", "runs"]
    newest = sorted((one for place in places for one in _folders_in(place, begun)), reverse=True)
    recorded = (path for _, path in newest if any(Path(path, name).exists() for name in RECORDED))
    return list(islice(recorded, MAX_FOLDERS))


def _folders_in(place: str, begun: str) -> Iterator[tuple[float, str]]:
    """(time of last change, path) of each."""
    try:
        with os.scandir(place) as listing:
            inside = [one for one in listing if one.path.removeprefix("./").startswith(begun)]
    # The folder does not exist, or may not be read: there is nothing to offer.
    except OSError:
        return
    for one in inside:
        # A loop of links, and a folder that is removed meanwhile, are passed over.
        with suppress(OSError):
            if one.is_dir():
                yield one.stat().st_mtime, one.path.removeprefix("./")


def _stems(folders: Iterable[str | Path], pattern: str) -> list[str]:
    return sorted({file.stem for folder in folders for file in Path(folder).glob(pattern) if not file.stem.startswith("_")})

"""Provenance of a recording: versions, files and their hashes, the plan, the devices, the clocks.

A simulated run is the same to the last byte when it is repeated with the same seed, machine, source
and person. So everything stated here is either one of these, or a time by the rig's own clock.

Also the state of the source that this program runs from, and how a run ended, in words for people
and in codes for sorting runs.
"""

import getpass
import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from rfca_rig import __version__
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.loop_gaps import GapCounter
from rfca_rig.errors import RigError, Tripped
from rfca_rig.protocol.plan import Plan
from rfca_rig.protocol.written_plan import serialize_plan

PACKAGE = Path(__file__).parents[1]
WITHIN_S = 5.0
NOT_A_CHECKOUT = "not a checkout"
UNKNOWN = "unknown"
_STATUS = ("git", "status", "--porcelain=v2", "--branch", "--untracked-files=no")
_REVISION = "# branch.oid "

DONE = "done"


def source_state(package: Path = PACKAGE) -> dict[str, str]:
    """Git revision, and whether tracked files were changed since; plain words where there is no
    checkout, or git fails.

    Takes some hundredths of a second, so it is called when a run begins and not when the program
    starts.
    """
    root = package.parent
    if not (root / ".git").exists():
        return {"git_revision": NOT_A_CHECKOUT, "git_dirty": NOT_A_CHECKOUT}
    lines = _status_lines(root)
    revision = next(
        (line.removeprefix(_REVISION) for line in lines if line.startswith(_REVISION)), UNKNOWN
    )
    if not lines:
        changed = UNKNOWN
    elif any(not line.startswith("#") for line in lines):
        changed = "yes"
    else:
        changed = "no"
    return {"git_revision": revision, "git_dirty": changed}


def _status_lines(root: Path) -> list[str]:
    """Lines of git status; none where git is missing, slow, or mistrusts another user's folder.
    The run goes on without.
    """
    # Without optional locks git status only reads: it does not disturb a git command that runs
    # meanwhile.
    environment = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}
    try:
        finished = subprocess.run(
            _STATUS,
            cwd=root,
            env=environment,
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return []
    return finished.stdout.splitlines()


@dataclass(frozen=True)
class Outcome:
    """`why` in words, the exit status of the command, and a reason code: that of a trip, else
    the kind of error, or `done`.
    """

    why: str
    exit_status: int
    reason: str

    @staticmethod
    def of(error: RigError | None) -> "Outcome":
        """None for a run that was completed."""
        if error is None:
            return Outcome(DONE, 0, DONE)
        if isinstance(error, Tripped):
            return Outcome(str(error), error.exit_code, str(error.code))
        # The class name in lower case with hyphens: DiskFull becomes disk-full.
        kind = re.sub(r"(?<!^)(?=[A-Z])", "-", type(error).__name__).lower()
        return Outcome(str(error), error.exit_code, kind)


def software_and_host(bench: Bench) -> dict[str, str]:
    """Software and machine, and when the run's clock began."""
    return {
        "rfca_rig_version": __version__,
        **source_state(),
        "python_version": platform.python_version(),
        "numpy_version": np.__version__,
        "h5py_version": h5py.__version__,
        "hdf5_version": h5py.version.hdf5_version,
        "host": platform.node(),
        "operating_system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "started_at": bench.clock.start_time().isoformat(),
    }


def operator_and_sample(name: str, sample: str) -> dict[str, str]:
    """Operator and specimen; "" for a specimen without a name."""
    return {"operator": operator(name), "sample": sample}


def operator(name: str) -> str:
    """The given name, else the login name."""
    try:
        return name or getpass.getuser()
    # A user without a name on this system, as in a container.
    except (OSError, KeyError):
        return UNKNOWN


def files(texts: Mapping[str, str]) -> dict[str, str]:
    """The text of each file by its name, and its SHA-256."""
    hashes = {
        f"{name}_sha256": hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()
    }
    return {**texts, **hashes}


def plan_fields(plan: Plan) -> dict[str, str]:
    """The whole resolved plan: `written_plan.parse_plan` restores it."""
    return serialize_plan(plan)


def devices(bench: Bench) -> dict[str, str]:
    """What the devices say of themselves, each with whether it is real."""
    parts: dict[str, Mapping[str, str]] = {
        "motor": bench.motor.identity(),
        "sensor": bench.sensor.identity(),
    }
    named = {
        f"{device}_{name}": text
        for device, identity in parts.items()
        for name, text in identity.items()
    }
    source = "REAL" if bench.is_real else "SIM"
    if bench.camera is None:
        return {**named, "motor_source": source, "sensor_source": source}
    return {
        **named,
        **bench.camera.identity(),
        "motor_source": source,
        "sensor_source": source,
        "camera_source": source,
    }


def streams(bench: Bench) -> dict[str, str]:
    """Completeness of the sensor's stream, as counts."""
    health = bench.sensor.health()
    counted = (
        f"{health.received} received, {health.lost} lost, {health.duplicate} twice, "
        f"{health.out_of_order} out of order"
    )
    bad = (
        f"{health.malformed} malformed, {health.faulty_status} with a bad status, "
        f"{health.saturated} saturated, {health.stalled} stalled"
    )
    return {"sensor_records": f"{counted}, {bad}"}


def loop_fields(gaps: GapCounter) -> dict[str, str]:
    """How regular the control loop was."""
    return {
        "worst_loop_gap_ms": f"{1e3 * gaps.longest_s:.3f}",
        "loop_gaps_ms": gaps.histogram().text(),
    }


def ending_fields(bench: Bench, outcome: Outcome) -> dict[str, str]:
    """How the run ended, and what the clocks showed then."""
    return {
        "ended": outcome.why,
        "exit_status": str(outcome.exit_status),
        "reason": outcome.reason,
        "ended_at": bench.clock.wall_time().isoformat(),
        "lasted_s": f"{bench.clock.now_s():.6f}",
    }

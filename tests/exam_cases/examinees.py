"""Simple diagnoses, importable by name so that processes can be handed them, and an exam to be
stopped from outside.
"""

import json
import os
import sys
import time
from pathlib import Path

from rfca_rig.executors.cores import cores

ANSWER = {"format": "rfca-diagnosis/1", "verdict": "not enough data", "effects": []}


def wants_more_data(campaign: Path, into: Path) -> None:
    assert (campaign / "campaign.toml").is_file()
    into.mkdir()
    (into / "diagnosis.json").write_text(json.dumps(ANSWER))


def tells_its_process(campaign: Path, into: Path) -> None:
    """Writes what a diagnosis that loads linear algebra now would find."""
    wants_more_data(campaign, into)
    told = {"threads": cores(), "openblas": os.environ.get("OPENBLAS_NUM_THREADS")}
    (into / "process.json").write_text(json.dumps(told))


def hangs_at_the_second(campaign: Path, into: Path) -> None:
    """Answers case 1; of any other only half, with its process's number."""
    wants_more_data(campaign, into)
    if campaign.name != "case-0001":
        (into / "pid").write_text(str(os.getpid()))
        time.sleep(float(os.environ.get("HANGS_S", "60")))


def main() -> None:
    """`rfca-rig prove` as typed, examining the one that hangs."""
    from rfca_rig.cli import main as command
    from rfca_rig.cli.commands import prove

    prove.diagnose_as_typed = hangs_at_the_second
    sys.argv = ["rfca-rig", *sys.argv[1:]]
    command.run()


if __name__ == "__main__":
    main()

"""Folders as runs leave them, without the samples."""

import json
from functools import cache
from pathlib import Path

from rfca_rig.description.protocol_file import read_plan
from rfca_rig.description.rig_file import read_rig
from rfca_rig.protocol.plan import Plan
from rfca_rig.protocol.written_plan import serialize_plan

ROOT = Path(__file__).parents[2]


@cache
def plan(protocol: str = "table2") -> Plan:
    return read_plan(
        ROOT / "protocols" / f"{protocol}.toml",
        read_rig(ROOT / "calibration" / "twin.toml").facts(),
    )


def run(
    folder: Path,
    planned: Plan,
    recorded: int = 99,
    ending: dict[str, str] | None = None,
    **known: str,
) -> Path:
    """A run of that plan of which so many stages were recorded; `ending` None leaves it
    unfinished.
    """
    (folder / "stages").mkdir(parents=True)
    source = known.pop("source", "SIM")
    provenance = {"operator": "", "sample": "", **serialize_plan(planned), **known}
    (folder / "run.json").write_text(
        json.dumps(
            {
                "format": "rfca-run/1",
                "title": planned.title,
                "source": source,
                "provenance": provenance,
            }
        )
    )
    stages = [
        stage for stage in planned.stages if type(stage).__name__ in ("Flap", "Hold", "Cycles")
    ][:recorded]
    begun = [{"event": "stage begins", "stage": stage.label} for stage in stages]
    events = [event for one in begun for event in (one, {"event": "stage recorded", "samples": {}})]
    (folder / "events.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
    if ending is not None:
        (folder / "end.json").write_text(json.dumps({"provenance": ending, "static": None}))
    return folder


DONE = {"ended": "done", "reason": "done"}
TRIPPED = {"ended": "TRIP F-02: following error", "reason": "F-02"}
STOPPED = {"ended": "stopped by the operator", "reason": "stopped"}

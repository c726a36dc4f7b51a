"""Identity of a sweep: a folder is continued only with exactly the same sweep."""

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rfca_rig import analysis, model, sweep
from rfca_rig.errors import BadInput
from rfca_rig.executors.environment import collect_facts, hash_source
from rfca_rig.model.catalogue import FOLDER_VARIABLE
from rfca_rig.recording.atomic import translate_os_errors, write_atomically
from rfca_rig.sweep.plan import SweepPlan

FORMAT = "rfca-sweep/1"
PLAN_FILE = "plan.json"
MADE_WITH = "made_with"


def describe_plan(plan: SweepPlan) -> dict[str, Any]:
    """The plan and its model as plain data, with the versions of the code, because changed code gives other numbers."""
    return {
        "format": FORMAT,
        "title": plan.title,
        "model": asdict(plan.rig),
        "fixed": dict(plan.fixed),
        "grid": [{"name": axis.name, "values": list(axis.values)} for axis in plan.axes],
        "samples": asdict(plan.samples) if plan.samples else None,
        "outputs": [asked.header for asked in plan.outputs],
        MADE_WITH: _describe_code(),
    }


def as_text(plan: SweepPlan) -> str:
    """The document as JSON text, which is compared byte by byte."""
    return json.dumps(describe_plan(plan), indent=1, ensure_ascii=False) + "\n"


def digest(text: str) -> str:
    """SHA-256 that identifies the plan in shards and results."""
    return hashlib.sha256(text.encode()).hexdigest()


def claim_folder(plan: SweepPlan, folder: Path) -> str:
    """Prepare `folder` for the plan, or check that it belongs to it; returns the plan's digest. Raises BadInput for another
    sweep's folder.
    """
    with translate_os_errors(folder, "the folder cannot be made"):
        folder.mkdir(parents=True, exist_ok=True)
    path, text = folder / PLAN_FILE, as_text(plan)
    if not path.exists():
        # A folder with other content was most likely named by mistake; nothing may be mixed into it.
        if strangers := sorted(each.name for each in folder.iterdir()):
            raise BadInput(f"{folder}: holds {strangers[0]}, which is of no sweep; give a new folder with --out")
        write_atomically(path, text.encode())
    elif (existing := path.read_text("utf-8", errors="replace")) != text:
        raise BadInput(f"{folder}: {_difference(existing, describe_plan(plan))}; give a new folder with --out, or remove this one")
    return digest(text)


def _difference(found: str, wanted: dict[str, Any]) -> str:
    try:
        there = json.loads(found)
        # Through JSON and back, so that tuples compare equal to lists.
        differing = [key.replace("_", " ") for key, value in json.loads(json.dumps(wanted)).items() if there.get(key) != value]
    except (ValueError, AttributeError):
        return f"{PLAN_FILE} is damaged"
    if differing == [MADE_WITH.replace("_", " ")]:
        unlike = [name for name, value in wanted[MADE_WITH].items() if there[MADE_WITH].get(name) != value]
        return f"its sweep was made with another {' and '.join(unlike)}, and results would not fit together"
    return f"holds a sweep with another {' and '.join(name for name in differing if name != 'made with') or 'form'}"


def _describe_code() -> dict[str, str]:
    # Everything that can change a result to the last digit: versions of the numerical packages, and hashes of our own sources.
    facts = collect_facts()
    versions = {name: facts[name] for name in ("rfca_rig", "numpy", "scipy", "numba", "llvmlite")}
    sources = "".join(hash_source(Path(package.__path__[0])) for package in (model, analysis, sweep))
    own = os.environ.get(FOLDER_VARIABLE)
    return {**versions, "source": digest(sources)[:12], "own effects": hash_source(Path(own)) if own else "none"}

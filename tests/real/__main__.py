"""The diagnosis of real recordings through MuJoCo: python -m tests.real FOLDER [SET...]

The recordings are taken from the folder RFCA_RIG_DATASETS, which `rfca-rig datasets get` fills.
Each set of the registry is put together in FOLDER and diagnosed. A set whose recordings are not
there is skipped, with a line. A row says what is stated, what was published, the rms error of each
position (joints by name) on held-out conditions before and after, and after a least-squares fit of
the published law by hand. The last column is the error that the statement closes over the error
that the hand fit closes, both as mean squares of all positions. Counts follow for each split.
Answers stay in FOLDER.
"""

import json
import math
import os
import sys
from pathlib import Path

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.catalogue import members_of
from rfca_rig.progress import ignore_share
from rfca_rig.public_data.library import write_set
from rfca_rig.public_data.registry import read_registry
from rfca_rig.public_data.sources import RECORDINGS_VARIABLE
from tests.public_recordings import explain_absence
from tests.real.hand_fit import fit_by_hand

SPLITS = ("development", "test", "added")
NOTHING = "nothing missing"
GOAL = 0.8  # share of what the fit by hand closes


def keep(path, make):
    """What `make` returns, kept in a file; of recordings that are refused, the words."""
    if not path.exists():
        try:
            found = make()
        except (BadInput, SimulationFailed) as error:
            found = {"refused": str(error)}
        path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def answer(name, described, out):
    """The answer about a set."""

    def make_answer():
        if not (out / name).is_dir():
            recordings = Path(os.environ[RECORDINGS_VARIABLE]) / described.group.name
            write_set(described, recordings, out / name)
        problem = MechanismProblem(read_experiment(out / name))
        found = diagnose(problem, ignore_share).diagnosis
        return {
            "grade": found.grade,
            "effects": {
                e.id: {n: [v.value, v.std] for n, v in e.parameters.items()} for e in found.effects
            },
            "family": found.family.id if found.family is not None and not found.effects else "",
            "held_out": {
                k: [f.before, f.after] for k, f in found.held_out.items() if "position" in k
            },
        }

    return keep(out / f"{name}.json", make_answer)


def fit_of(name, described, out):
    """Values and held-out errors of the fit by hand."""

    def fit():
        found = fit_by_hand(read_experiment(out / name), described.law)
        return {"values": found.values, "held_out": found.held_out}

    return keep(out / f"{name}-by-hand.json", fit)


def closed_share(said, by_hand):
    """The mean square that a statement closes on held-out conditions over that of the fit by
    hand; NaN where that closes nothing.
    """
    before, after = (sum(pair[k] ** 2 for pair in said["held_out"].values()) for k in (0, 1))
    of_hand = before - sum(error**2 for error in by_hand["held_out"].values())
    if of_hand > 0.0:
        return (before - after) / of_hand
    return math.nan


def is_silent(said):
    """Whether nothing is stated."""
    return not (said["effects"] or said["family"])


def contradicts(said, described):
    """Whether an effect is stated that was not published, or a family without one that was."""
    stated = [{name} for name in said["effects"]] or (
        [members_of(said["family"])] if said["family"] else []
    )
    return any(not members & set(described.right) for members in stated)


def row_of(name, described, said, by_hand):
    """A row of the table."""
    head = f"| {name} | {described.split} |"
    if "refused" in said:
        return f"{head} refused: {said['refused']} | {described.published} | | | |"
    sizes = "; ".join(
        f"`{effect}` " + ", ".join(f"{v:.3g} +- {1.645 * s:.2g}" for v, s in values.values())
        for effect, values in said["effects"].items()
    )
    stated = (
        f"{said['grade']}: "
        f"{sizes or said['family'] or '-'}{' CONTRADICTED' if contradicts(said, described) else ''}"
    )
    errors = ", ".join(
        f"{before:.3g} to {after:.3g}" for _, (before, after) in sorted(said["held_out"].items())
    )
    if "refused" in by_hand:
        return (
            f"{head} {stated} | {described.published} | {errors} | refused: "
            f"{by_hand['refused']} | |"
        )
    of_law = {
        key: value
        for key, (value, _) in by_hand["values"].items()
        if key.rsplit(".", 1)[-1] in described.law
    }
    values = ", ".join(f"{key} {value:.3g}" for key, value in of_law.items())
    after = ", ".join(f"{error:.3g}" for _, error in sorted(by_hand["held_out"].items()))
    return (
        f"{head} {stated} | {described.published} | {errors} | {after} ({values}) | "
        f"{closed_share(said, by_hand):.2f} |"
    )


def count(split, found):
    """In words how many sets of a split reach the goal, are silent, or are contradicted."""
    of_split = [
        (described, said, by_hand) for described, said, by_hand in found if described.split == split
    ]
    heard = [one for one in of_split if "refused" not in one[1]]
    to_close = [
        (said, by_hand)
        for d, said, by_hand in heard
        if not d.negligible and "refused" not in by_hand
    ]
    closed = sum(closed_share(said, by_hand) >= GOAL for said, by_hand in to_close)
    silent = sum(is_silent(said) for _, said, _ in heard)
    contradicted = sum(contradicts(said, d) for d, said, _ in heard)
    denied = sum(said["grade"] == NOTHING and not d.negligible for d, said, _ in heard)
    words = (
        f"{closed} of {len(to_close)} close {GOAL:g} of what the hand fit closes, "
        f"{contradicted} contradicted, {silent} silent"
    )
    return (
        f"{split}: {len(of_split)} sets, {words} ({denied} of them say that nothing is "
        f"missing), {len(of_split) - len(heard)} refused"
    )


def main(out, names):
    """A row for each set, then the counts."""
    sets = read_registry().sets
    found = []
    out.mkdir(parents=True, exist_ok=True)
    print(
        "| recordings | split | stated | published | held-out rms of the positions | by "
        "hand | closed, of what the hand fit closes |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in names or sets:
        absence = explain_absence(sets[name].group.name)
        if absence:
            print(f"| {name} | {sets[name].split} | skipped: {absence} | | | | |")
            continue
        said = answer(name, sets[name], out)
        if "refused" in said:
            by_hand = said
        else:
            by_hand = fit_of(name, sets[name], out)
        print(row_of(name, sets[name], said, by_hand), flush=True)
        found.append((sets[name], said, by_hand))
    print()
    for split in SPLITS:
        print(count(split, found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

"""The diagnosis of real recordings through MuJoCo: python -m tests.real FOLDER [SET...]

Each set of sets.toml is put together in FOLDER and diagnosed. A row says what is stated, what was published, the rms error of each
position on held-out conditions before and after, and after a least-squares fit of the published law by hand. The last column is the error
that the statement closes over the error that the hand fit closes, both as mean squares of all positions. Answers stay in FOLDER.
"""

import json
import shutil
import sys
import tomllib
from pathlib import Path

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.diagnose import diagnose_mechanism
from rfca_rig.model.families import members_of
from tests.real.hand_fit import fit_by_hand

HERE = Path(__file__).parent
DATA = HERE.parent / "data"


def put_together(name, described, folder):
    """Description and model file of a set beside its recordings."""
    shutil.copytree(DATA / described["recordings"] / "runs", folder / "runs")
    for file in ("experiment.toml", "model.xml"):
        shutil.copy(HERE / name / file, folder)


def answer(name, described, out):
    """The answer about a set, kept in a file."""
    path = out / f"{name}.json"
    if not path.exists():
        if not (out / name).is_dir():
            put_together(name, described, out / name)
        found = diagnose_mechanism(read_experiment(out / name), lambda *_: None).diagnosis
        said = {
            "grade": found.grade,
            "effects": {e.id: {n: [v.value, v.std] for n, v in e.parameters.items()} for e in found.effects},
            "family": found.family.id if found.family is not None and not found.effects else "",
            "held_out": {k: [f.before, f.after] for k, f in found.held_out.items() if "position" in k},
        }
        path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def fit_of(name, described, out):
    """Values and held-out errors of the fit by hand, kept in a file."""
    path = out / f"{name}-by-hand.json"
    if not path.exists():
        found = fit_by_hand(read_experiment(out / name), described["law"])
        path.write_text(json.dumps({"values": found.values, "held_out": found.held_out}, indent=1), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def closed_share(said, by_hand):
    """The mean square that a statement closes on held-out conditions over that of the fit by hand."""
    before, after = (sum(pair[k] ** 2 for pair in said["held_out"].values()) for k in (0, 1))
    return (before - after) / (before - sum(error**2 for error in by_hand["held_out"].values()))


def contradicts(said, described):
    """Whether an effect is stated that was not published, or a family without one that was."""
    stated = [{name} for name in said["effects"]] or ([members_of(said["family"])] if said["family"] else [])
    return any(not members & set(described["right"]) for members in stated)


def read_sets():
    """The sets by name."""
    return tomllib.loads((HERE / "sets.toml").read_text(encoding="utf-8"))


def main(out, names):
    """A row for each set."""
    sets = read_sets()
    out.mkdir(parents=True, exist_ok=True)
    print("| recordings | stated | published | held-out rms of the positions | by hand | closed, of what the hand fit closes |")
    print("|---|---|---|---|---|---|")
    for name in names or sets:
        said = answer(name, sets[name], out)
        sizes = "; ".join(
            f"`{effect}` " + ", ".join(f"{v:.3g} +- {1.645 * s:.2g}" for v, s in values.values())
            for effect, values in said["effects"].items()
        )
        stated = f"{said['grade']}: {sizes or said['family'] or '-'}{' CONTRADICTED' if contradicts(said, sets[name]) else ''}"
        errors = ", ".join(f"{before:.3g} to {after:.3g}" for before, after in said["held_out"].values())
        by_hand = fit_of(name, sets[name], out)
        of_law = {key: value for key, (value, _) in by_hand["values"].items() if key.rsplit(".", 1)[-1] in sets[name]["law"]}
        values = ", ".join(f"{key} {value:.3g}" for key, value in of_law.items())
        after = ", ".join(f"{error:.3g}" for error in by_hand["held_out"].values())
        share = f"{closed_share(said, by_hand):.2f}"
        print(f"| {name} | {stated} | {sets[name]['published']} | {errors} | {after} ({values}) | {share} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

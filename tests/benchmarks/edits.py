"""Edits of a finished run: whether `check` finds each, and `check` and `recover` agree on what
helps.

python -m tests.benchmarks.edits [--random N] [--seed SEED]
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from tests.recording.edits import find_fault, finish_run, random_edits, whole_file_edits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--random", type=int, default=500, help="edits at random places")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        finish_run(place / "run", (1, 2, 3), place / "older")
        finish_run(place / "other", (2, 3, 4))
        edits = [
            *whole_file_edits(place / "run", place / "other", place / "older"),
            *random_edits(place / "run", asked.random, asked.seed),
        ]
        faults = Counter[str]()
        for edit in edits:
            if fault := find_fault(place / "run", edit, place / "copy"):
                faults[fault] += 1
                print(f"{edit.name}: {fault}", flush=True)
        print(
            f"{len(edits)} edits: {faults['not found']} not found, "
            f"{faults.total() - faults['not found']} where check and recover differ"
        )


if __name__ == "__main__":
    main()

"""Malformed inputs by the thousand, and how many end otherwise than in one line or a normal result.

    python -m tests.benchmarks.malformed --cases 1000 --seed 7

A violation has the number of its case; `--only N` runs that one and shows what it printed.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.cli.malformed_inputs import Recordings, find_violations, make_cases, show


def main() -> None:
    """Run the cases; exit code 1 where one is a violation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int)
    asked = parser.parse_args()
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        os.environ["XDG_CONFIG_HOME"] = place
        recordings = Recordings(Path(place))
        if asked.only is not None:
            _, case = next(
                one
                for one in enumerate(make_cases(asked.seed, asked.cases, recordings))
                if one[0] == asked.only
            )
            print(case.label, case.words)
            print(show(case, Path(tempfile.mkdtemp(dir=place))))
            return
        found = Counter()
        for number, case in enumerate(make_cases(asked.seed, asked.cases, recordings)):
            folder = Path(place, f"{number}")
            folder.mkdir()
            violations = find_violations(case, folder)
            for violation in violations:
                print(f"{number:5d}  {case.label}: {violation}", flush=True)
            found["violated"] += bool(violations)
            shutil.rmtree(folder, ignore_errors=True)
    print(
        f"{found['violated']} of {asked.cases} cases violated, seed {asked.seed}, "
        f"{time.monotonic() - began_s:.0f} s"
    )
    sys.exit(bool(found["violated"]))


if __name__ == "__main__":
    main()

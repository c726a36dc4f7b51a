"""How long `rfca-rig runs` and <TAB> take.

Run: python -m tests.benchmarks.logbook [--runs 5000] [--short]

Runs without samples, as they are listed from three small text files each. First without an index,
then with it, then with one run changed; the same as commands, which also start Python; and what the
shell waits for behind <TAB>.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rfca_rig.logbook.listing import NAME, list_runs
from tests.logbook.made import DONE, plan, run

COMMAND = Path(sys.executable).parent / "rfca-rig"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5000, help="how many there are")
    parser.add_argument("--short", action="store_true", help="300 of them, fewer rounds")
    asked = parser.parse_args()
    number, rounds = (300, 3) if asked.short else (asked.runs, 7)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        runs = _made(Path("runs"), number)
        first_s = _seconds(lambda: list_runs(runs))
        again_s = _median(lambda: list_runs(runs), rounds)
        changed_s = _median(
            lambda: (os.utime(runs / "SIM-0" / "run.json"), list_runs(runs)), rounds
        )
        size_MB = (runs / NAME).stat().st_size / 1e6
        command_s = _median(
            lambda: _command("runs", "--paths", "--height", "235", "--last", "1"), rounds
        )
        tab_s = _median(lambda: _command(**_asking("rfca-rig check runs/")), rounds)
    print(
        f"{number} runs listed without an index   {1e3 * first_s:8.0f} ms   "
        f"{1e3 * first_s / number:6.2f} ms a run"
    )
    print(
        f"the same with it, {size_MB:4.1f} MB            {1e3 * again_s:8.0f} ms   "
        f"{first_s / again_s:6.1f} times as fast"
    )
    print(f"with one run changed                {1e3 * changed_s:8.0f} ms")
    print(f"rfca-rig runs, with Python's start  {1e3 * command_s:8.0f} ms")
    print(f"rfca-rig check runs/<TAB>           {1e3 * tab_s:8.0f} ms")


def _made(runs: Path, number: int) -> Path:
    planned = plan("table2")
    first = run(runs / "SIM-0", planned, ending=DONE)
    texts = {file.name: file.read_text() for file in first.iterdir() if file.is_file()}
    header = json.loads(texts["run.json"])
    for k in range(1, number):
        (runs / f"SIM-{k}" / "stages").mkdir(parents=True)
        header["provenance"]["sample"] = f"leg {k}"
        for name, text in {**texts, "run.json": json.dumps(header)}.items():
            (runs / f"SIM-{k}" / name).write_text(text)
    return runs


def _asking(line: str) -> dict[str, dict[str, str]]:
    return {
        "env": {
            "_RFCA_RIG_COMPLETE": "complete_bash",
            "COMP_WORDS": line,
            "COMP_CWORD": str(len(line.split(" ")) - 1),
        }
    }


def _command(*words: str, env: dict[str, str] | None = None) -> None:
    subprocess.run(
        [COMMAND, *words], env={**os.environ, **(env or {})}, check=True, capture_output=True
    )


def _seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def _median(work: Callable[[], object], rounds: int) -> float:
    """After one round that does not count."""
    work()
    return statistics.median(_seconds(work) for _ in range(rounds))


if __name__ == "__main__":
    main()

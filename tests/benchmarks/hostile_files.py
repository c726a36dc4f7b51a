"""Every hostile model, TOML file, table and bag through `rfca-rig check`, as a user would.

Run: python -m tests.benchmarks.hostile_files [WORDS]

Each is one file of an experiment that is otherwise sound, or a TOML file alone. Each must end in
one line with exit code 2, or be taken where it is harmless, within 15 s. Prints what ends
otherwise, and a summary. WORDS select inputs by their names.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.campaign.hostile_inputs import BAGS, MODELS, TABLES, TOMLS, Write
from tests.cli.malformed_inputs import CART, EXPERIMENT, MECHANISM

PROGRAM = (sys.executable, "-P", "-m", "rfca_rig", "check")
MAX_TIME_S = 15.0
# Reading may take 2 GiB beyond what the program has, which is 0.3.
MAX_MEMORY_GB = 2.7
KILLED_AFTER_S = 120.0
MISTAKE = "mistake in rfca-rig"


@dataclass(frozen=True)
class Case:
    """`file` is written by `write`; `recording` is the file that the experiment names, `checked`
    what the command gets, in the folder.
    """

    name: str
    file: str
    write: Write
    recording: str = "a.csv"
    checked: str = "."


@dataclass(frozen=True)
class Result:
    exit_code: int
    error: str
    time_s: float
    memory_GB: float

    @property
    def faults(self) -> list[str]:
        """What must not be, in words."""
        # Progress is written over itself within one line.
        lines = [
            line for line in self.error.splitlines() if line.startswith(("error", "rfca-rig:"))
        ]
        faults = {
            f"exit code {self.exit_code}": self.exit_code not in (0, 2),
            f"{len(lines)} lines of error": self.exit_code == 2 and len(lines) != 1,
            MISTAKE: MISTAKE in self.error or "Traceback" in self.error,
            f"{self.time_s:.1f} s": self.time_s > MAX_TIME_S,
            f"{self.memory_GB:.1f} GB": self.memory_GB > MAX_MEMORY_GB,
        }
        return [fault for fault, is_there in faults.items() if is_there]


def list_cases() -> Iterator[Case]:
    for name, write in MODELS.items():
        yield Case(f"model: {name}", "model.xml", write)
    for name, write in TOMLS.items():
        yield Case(f"experiment: {name}", "experiment.toml", write)
        yield Case(f"TOML file: {name}", "rig.toml", write, checked="rig.toml")
    for name, write in TABLES.items():
        yield Case(f"table: {name}", "a.csv", write)
    for name, write in BAGS.items():
        yield Case(f"bag: {name}", "a.mcap", write, recording="a.mcap")


def check(case: Case, folder: Path) -> Result:
    """Runs the command on the case in an empty folder."""
    sound = {
        "experiment.toml": EXPERIMENT.replace("a.csv", case.recording),
        "model.xml": MECHANISM,
        "a.csv": CART,
    }
    for name in sound.keys() - {case.file}:
        (folder / name).write_text(sound[name], encoding="utf-8")
    case.write(folder / case.file)
    environment = {**os.environ, "XDG_CONFIG_HOME": str(folder)}
    with tempfile.TemporaryFile() as error:
        began_s = time.monotonic()
        process = subprocess.Popen(
            ["timeout", "--kill-after=1", f"{KILLED_AFTER_S:g}", *PROGRAM, case.checked],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=error,
        )
        _, status, usage = os.wait4(process.pid, 0)
        time_s = time.monotonic() - began_s
        process.returncode = os.waitstatus_to_exitcode(status)
        error.seek(0)
        return Result(
            process.returncode,
            error.read().decode("utf-8", "replace"),
            time_s,
            usage.ru_maxrss * 1024 / 1e9,
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*")
    parser.add_argument("--show", action="store_true", help="print the line of each")
    arguments = parser.parse_args()
    results: dict[str, Result] = {}
    for case in list_cases():
        if not all(word in case.name for word in arguments.words):
            continue
        with tempfile.TemporaryDirectory() as folder:
            result = results[case.name] = check(case, Path(folder))
        if result.faults or arguments.show:
            print(
                (
                    f"{case.name}: {', '.join(result.faults) or 'as it should'}; "
                    f"{result.error.strip()[-400:]}"
                ),
                flush=True,
            )
    refused = [result for result in results.values() if result.exit_code == 2 and not result.faults]
    taken = [result for result in results.values() if result.exit_code == 0 and not result.faults]
    slowest = max(results, key=lambda name: results[name].time_s)
    largest = max(results, key=lambda name: results[name].memory_GB)
    print(
        (
            f"{len(results)} inputs: {len(refused)} refused in one line with exit code 2, "
            f"{len(taken)} taken, "
        ),
        end="",
    )
    print(
        f"{sum(MISTAKE in result.error for result in results.values())} times {MISTAKE!r}; ", end=""
    )
    print(
        f"longest {results[slowest].time_s:.1f} s ({slowest}), most memory "
        f"{results[largest].memory_GB:.2f} GB ({largest})"
    )
    sys.exit(len(refused) + len(taken) < len(results))


if __name__ == "__main__":
    main()

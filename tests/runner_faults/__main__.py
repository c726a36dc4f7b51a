"""python -m tests.runner_faults [FILE] [--cheap]: the fault table on the twin of the leg, onto the
screen and into a file.

With --cheap on the plant and at the rates of the tests.
"""

import sys
from pathlib import Path

from tests.runner_faults.causes import CAUSES
from tests.runner_faults.rig import CHEAP, TRUE
from tests.runner_faults.table import foot, head, rows


def main(words: list[str]) -> None:
    fidelity = CHEAP if "--cheap" in words else TRUE
    files = [Path(word) for word in words if not word.startswith("--")]
    lines = [head(fidelity)]
    for line in rows(CAUSES, fidelity):
        print(line, flush=True)
        lines.append(line)
    for file in files:
        file.write_text("\n".join([*lines, foot()]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])

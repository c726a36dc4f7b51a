"""The command line as `python -m rfca_rig`, where the command `rfca-rig` is not on the path."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # Python put the current folder first. What lies in it is data, and no module of this program or
    # of its workers.
    del sys.path[0]

from rfca_rig.cli.main import run

if __name__ == "__main__":
    run()

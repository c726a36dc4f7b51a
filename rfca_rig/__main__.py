"""The command line as `python -m rfca_rig`, where the command `rfca-rig` is not on the path."""

from rfca_rig.cli.main import run

if __name__ == "__main__":
    run()

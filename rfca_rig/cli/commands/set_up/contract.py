"""rfca-rig contract"""

from typing import Annotated

import typer


def contract(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="A rig file with a motor or a force sensor of your own.")],
) -> None:
    """Try your own driver on its twin with everything that every driver must do: energise without a jerk, obey, report, name each fault.

    Nothing real is touched. Exit code 1 where something is not as it must be; the names of the tests say what.

    Example: rfca-rig contract our-rig.toml
    """
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput

    path = find_rig(rig)
    described = read_rig(path)
    try:
        from rfca_rig.contracts.own_devices import run_conformance_tests
    # pytest is not installed with the package; only this command needs it.
    except ModuleNotFoundError as missing:
        raise BadInput(f"the contract needs {missing.name}; type pip install pytest") from None
    if not run_conformance_tests(described, path.resolve()):
        raise typer.Exit(1)
    typer.echo(f"{described.rig.title}: the contract is kept; next: rfca-rig doctor --rig {rig}")

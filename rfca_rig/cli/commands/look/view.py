"""rfca-rig view"""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer


def view(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run's folder, its run.h5, or a campaign.")],
    port: Annotated[int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="The port; any free one if not given.")] = 0,
) -> None:
    """Play a recording in the browser, on the page on which --view shows a run; ^C ends it.

    Only this computer can open the address that is printed.

    Example: rfca-rig view runs/SIM-table-ii-001
    """
    from rfca_rig.view.live_view import check_view_is_installed

    check_view_is_installed()
    # After the check: this import needs the packages of the extra.
    from rfca_rig.view.replay import replay

    with suppress(KeyboardInterrupt):
        replay(run, port, lambda url: typer.echo(f"open {url} (^C here ends it)", err=True))

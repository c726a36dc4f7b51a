"""What --pdf does: says before the work that there is nothing to print with, and prints the pages after it."""

from collections.abc import Iterable
from pathlib import Path

import typer


class Printing:
    """Raises BadInput at once where PDFs are wanted and no browser is there."""

    def __init__(self, wanted: bool) -> None:
        from rfca_rig.report.pdf import find_browser

        self._browser = find_browser() if wanted else None

    def print(self, pages: Iterable[Path], quiet: bool) -> None:
        """Nothing where none are wanted."""
        from rfca_rig.report.pdf import print_pdfs

        if self._browser is None:
            return
        for printed in print_pdfs(self._browser, pages):
            if not quiet:
                typer.echo(f"{printed}: the same page, printed", err=True)

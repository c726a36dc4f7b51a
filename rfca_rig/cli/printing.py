"""The option --pdf: fails before the work where there is no browser to print with, and prints the pages afterwards."""

from collections.abc import Iterable
from pathlib import Path

import typer


class Printing:
    """Raises BadInput at once where PDFs are wanted and no browser is found."""

    def __init__(self, wanted: bool) -> None:
        from rfca_rig.reports.pdf import find_browser

        self._browser = find_browser() if wanted else None

    def print(self, pages: Iterable[Path], quiet: bool) -> None:
        """Prints the pages; does nothing where no PDFs are wanted."""
        from rfca_rig.reports.pdf import print_pdfs

        if self._browser is None:
            return
        for printed in print_pdfs(self._browser, pages):
            if not quiet:
                typer.echo(f"{printed}: the same page, printed", err=True)

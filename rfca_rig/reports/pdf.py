"""A page as PDF, printed by a browser of this machine, so that it looks as it does on the screen.

Chromium, Chrome, Edge and Brave print without a window. WeasyPrint was tried instead: it is slower,
joins lines of the figures that are interrupted, ignores clipping of curves, and needs system
libraries as well.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.atomic import write_atomically

VARIABLE = "RFCA_RIG_BROWSER"
NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
    "brave-browser",
)
PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
WITHIN_S = 120.0
# No window, no network traffic of the browser itself, no page header or footer.
QUIET = (
    "--headless",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--no-pdf-header-footer",
)
# Dates in the PDF, which are replaced so that the same page gives the same bytes.
DATE = re.compile(rb"/(CreationDate|ModDate) \(D:\d{14}\+00'00'\)")
# Links to other files; those within the page begin with "#" and stay.
LINK = re.compile(r'<a href="(?!#)[^"]*">')


def find_browser() -> Path:
    """A browser that can print. Raises BadInput with advice where there is none."""
    chosen = os.environ.get(VARIABLE)
    if chosen:
        browser = shutil.which(chosen)
    else:
        browser = next(filter(None, map(shutil.which, (*NAMES, *PLACES))), None)
    if browser is None:
        if chosen:
            missing = f"{chosen!r}, which {VARIABLE} names, is not there"
        else:
            missing = "no Chromium, Chrome, Edge or Brave is there to print with"
        raise BadInput(
            f"--pdf: {missing}; install one, name it with {VARIABLE}, or open the page in "
            "any browser and print it to a file"
        )
    return Path(browser)


def print_pdfs(browser: Path, pages: Iterable[Path]) -> list[Path]:
    """Prints each page to a PDF beside it. The same page and browser give the same bytes. Raises
    RigError where the browser fails.
    """
    return [_print(browser, page) for page in pages]


def _print(browser: Path, page: Path) -> Path:
    target = page.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(prefix="rfca-rig-") as folder:
        copy = Path(folder) / page.name
        printed = Path(folder) / target.name
        # The browser would write the absolute path of every linked file into the PDF.
        copy.write_text(LINK.sub("<a>", page.read_text("utf-8")), "utf-8")
        # A profile in the temporary folder: the user's own profile is neither read nor changed.
        # Option for running as root, as in a container: Chromium refuses its sandbox there.
        if sys.platform != "win32" and os.geteuid() == 0:
            root = ["--no-sandbox"]
        else:
            root = []
        message = _run(
            [
                str(browser),
                *QUIET,
                *root,
                f"--user-data-dir={folder}/profile",
                f"--print-to-pdf={printed}",
                copy.as_uri(),
            ]
        )
        # The file tells success: browsers report warnings on stderr when all went well.
        if not printed.is_file():
            raise RigError(
                f"{page}: {browser.name} made no PDF of it: "
                f"{message or 'without a word'}; open the page and print it to a file"
            )
        write_atomically(target, DATE.sub(rb"/\1 (D:20000101000000+00'00')", printed.read_bytes()))
    return target


def _run(command: list[str]) -> str:
    """Runs a command and returns the last line of its stderr, or the error that kept it from
    running.
    """
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=WITHIN_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__}: {error}".replace("\n", " ")
    return (done.stderr.strip().splitlines() or [""])[-1]

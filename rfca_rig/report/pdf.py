"""A page as PDF, printed by a browser that is on this machine: the very page, drawn by what it was made for.

Chromium, Chrome, Edge and Brave print without a window. WeasyPrint was tried instead and draws these pages slower, with broken lines of
the figures unbroken and clipped curves unclipped, and needs libraries of the system too.
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
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge", "microsoft-edge-stable", "msedge",
    "brave-browser",
)  # fmt: skip
PLACES = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
)
WITHIN_S = 120.0
QUIET = (
    "--headless", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-extensions", "--no-pdf-header-footer",
)  # fmt: skip
DATE = re.compile(rb"/(CreationDate|ModDate) \(D:\d{14}\+00'00'\)")
LINK = re.compile(r'<a href="(?!#)[^"]*">')


def find_browser() -> Path:
    """One that can print. Raises BadInput with what to do where there is none."""
    named = os.environ.get(VARIABLE)
    found = shutil.which(named) if named else next(filter(None, map(shutil.which, (*NAMES, *PLACES))), None)
    if found is None:
        missing = (
            f"{named!r}, which {VARIABLE} names, is not there" if named else "no Chromium, Chrome, Edge or Brave is there to print with"
        )
        raise BadInput(f"--pdf: {missing}; install one, name it with {VARIABLE}, or open the page in any browser and print it to a file")
    return Path(found)


def print_pdfs(browser: Path, pages: Iterable[Path]) -> list[Path]:
    """Each page as PDF beside it, of the same bytes for the same page and browser. Raises RigError where the browser fails."""
    return [_print(browser, page) for page in pages]


def _print(browser: Path, page: Path) -> Path:
    target = page.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(prefix="rfca-rig-") as folder:
        copy, printed = Path(folder) / page.name, Path(folder) / target.name
        copy.write_text(LINK.sub("<a>", page.read_text("utf-8")), "utf-8")  # a browser would tell the whole path of what is linked
        said = _run([str(browser), *QUIET, *_as_root(), f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}", copy.as_uri()])
        if not printed.is_file():
            raise RigError(f"{page}: {browser.name} made no PDF of it: {said or 'without a word'}; open the page and print it to a file")
        write_atomically(target, DATE.sub(rb"/\1 (D:20000101000000+00'00')", printed.read_bytes()))
    return target


def _run(command: list[str]) -> str:
    """The last thing that it said."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=WITHIN_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__}: {error}".replace("\n", " ")
    return (done.stderr.strip().splitlines() or [""])[-1]


def _as_root() -> list[str]:
    """Chromium refuses to be run by root, as in a container, with its sandbox."""
    return ["--no-sandbox"] if sys.platform != "win32" and os.geteuid() == 0 else []

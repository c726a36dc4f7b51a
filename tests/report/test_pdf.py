"""Pages printed by a browser: a stand-in that tells what it was given, and a real one where
there is one.
"""

import os
import re
import sys
import zlib

import pytest

from rfca_rig.errors import BadInput, RigError
from rfca_rig.reports.pdf import NAMES, VARIABLE, find_browser, print_pdfs
from rfca_rig.reports.strokes.page import write_report
from tests.cli.typed import typed
from tests.report.recordings import recording, stages

STAND_IN = """#!{python}
import sys
from pathlib import Path
from urllib.parse import unquote
target = next(word.partition("=")[2] for word in sys.argv if word.startswith("--print-to-pdf="))
page = Path(unquote(sys.argv[-1].removeprefix("file://"))).read_bytes()
Path(target).write_bytes(b"%PDF /CreationDate (D:20261122014937+00'00') /ModDate (D:20261122014937+00'00')" + page)
"""
BROKEN = "#!/bin/sh\necho 'no display, no fonts, nothing' >&2\nexit 1\n"


@pytest.fixture
def browser(tmp_path, monkeypatch):
    def made(text=STAND_IN):
        path = tmp_path / "bin" / "browser"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text.replace("{python}", sys.executable))
        path.chmod(0o755)
        monkeypatch.setenv(VARIABLE, str(path))
        return path

    return made


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_what_is_printed_is_the_page_without_dates_and_without_paths(tmp_path, browser):
    browser()
    page = tmp_path / "a page.html"
    page.write_text('<p>words</p><a href="run.html">the run</a><a href="#here">here</a>')
    (printed,) = print_pdfs(find_browser(), [page])
    content = printed.read_bytes()
    assert printed == tmp_path / "a page.pdf"
    assert content.count(b"D:20000101000000") == 2 and b"20261122" not in content
    assert b"<p>words</p><a>the run</a>" in content and b'href="#here"' in content


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_a_browser_that_fails_is_said_in_one_line(tmp_path, browser):
    browser(BROKEN)
    page = tmp_path / "page.html"
    page.write_text("<p>")
    with pytest.raises(
        RigError,
        match=r"page.html: browser made no PDF of it: no display, no fonts, nothing; open the page",
    ) as raised:
        print_pdfs(find_browser(), [page])
    assert "\n" not in str(raised.value) and not (tmp_path / "page.pdf").exists()


def test_without_a_browser_nothing_is_begun(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, "no-such-browser")
    for words in (
        ("report", "nowhere"),
        ("static", "report", "nowhere"),
        ("diagnose", "nowhere"),
        ("prove", "--out", "exam"),
    ):
        said = typed(monkeypatch, capsys, *words, "--pdf")
        assert said.exit_code == 2 and said.err.count("\n") == 1 and "no-such-browser" in said.err
    assert list(tmp_path.iterdir()) == []
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("rfca_rig.reports.pdf.PLACES", ())
    with pytest.raises(
        BadInput, match="install one, name it with RFCA_RIG_BROWSER, or open the page"
    ):
        find_browser()


def real_browser():
    try:
        return find_browser()
    except BadInput:
        return None


@pytest.mark.slow
@pytest.mark.skipif(real_browser() is None, reason=f"none of {', '.join(NAMES)} is here")
def test_a_real_browser_prints_a_sheet_of_a4_with_the_words_of_the_page(tmp_path):
    written = write_report([recording(static=stages())], tmp_path)
    printed = print_pdfs(real_browser(), written.pages)
    assert [one.name for one in printed] == ["report.pdf", "run.pdf"]
    content = printed[0].read_bytes()
    assert (
        content.startswith(b"%PDF-")
        and b"D:20000101000000" in content
        and os.fsencode(tmp_path) not in content
    )
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", content)
    assert boxes and all(
        abs(float(w) - 595.3) < 1.0 and abs(float(h) - 841.9) < 1.0 for w, h in boxes
    )
    drawn = b"".join(
        _inflated(part)
        for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL)
    )
    assert drawn.count(b"Tj") + drawn.count(b"TJ") > 50, "words are words, not pictures of them"


def _inflated(part):
    try:
        return zlib.decompress(part)
    except zlib.error:
        return b""

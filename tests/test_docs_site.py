"""The documentation site builds without a warning, holds every page, and needs no network."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("furo", reason='the site needs the extra docs: pip install -e ".[docs]"')

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
LOADS = re.compile(
    r"""<(?:script|img|iframe)\b[^>]*\bsrc="(https?:[^"]+)|<link\b[^>]*\bhref="(https?:[^"]+)|@import[^;]*https?:"""
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site. Sphinx also warns of a page that no toctree holds, and of a link that leads
    nowhere.

    The tag skips the notebook whose diagnosis takes longer than the rest of the site;
    tests/notebook executes the same cells and checks what they give. The other notebooks show that
    Jupyter runs them, and that the pages take tables, pictures and text.
    """
    out = tmp_path_factory.mktemp("site")
    options = ["-q", "-W", "--keep-going", "-t", "without_diagnosis", "-d", str(out / "doctrees")]
    command = [sys.executable, "-m", "sphinx", *options, str(DOCS), str(out / "html")]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return out / "html"


def test_every_page_is_built(site):
    sources = {path.relative_to(DOCS).with_suffix("") for path in DOCS.rglob("*.md")}
    assert sources <= {path.relative_to(site).with_suffix("") for path in site.rglob("*.html")}


def test_links_to_schemas_lead_to_files(site):
    """Sphinx does not check these links, since the generator writes the files at the end."""
    linked = {
        schema
        for page in (site / "reference").glob("*.html")
        for schema in re.findall(r'href="(schemas/[^"]+)"', page.read_text())
    }
    assert linked and linked == {
        f"schemas/{path.name}" for path in (site / "reference" / "schemas").iterdir()
    }


def test_marks_of_the_reference_are_filled(site):
    commands, effects, rig = (
        (site / "reference" / f"{page}.html").read_text()
        for page in ("commands", "effects", "rig-file")
    )
    assert 'id="rfca-rig-dynamic-run"' in commands and "--height" in commands
    assert 'id="hinge-backlash"' in effects and "half_gap_deg" in effects
    assert "following_error_deg" in rig and "deg s/rad" in rig


def test_no_page_loads_anything_from_elsewhere(site):
    assert [
        found
        for path in site.rglob("*")
        if path.suffix in (".html", ".css")
        for found in LOADS.findall(path.read_text())
    ] == []

"""Sphinx configuration of the documentation site.

`python -m sphinx -W --keep-going -j auto docs build/site` builds it, with the extra `docs` and
without network. The pages are Markdown; those of the reference are filled from the code by
`reference_pages`, and notebooks are executed.

All pages are read again, and the notebooks executed, where the code or the packages of the
environment have changed. Otherwise a notebook is executed again only if its own cells have changed.
"""

import hashlib
import shutil
import sys
from importlib.metadata import distributions
from pathlib import Path

from sphinx.application import Sphinx

import rfca_rig

DOCS = Path(__file__).parent
ROOT = DOCS.parent
# What the notebooks and the pages of the reference are made from.
SOURCES = ("rfca_rig", "calibration", "protocols", "tests/data/pendulums", "docs/examples")

sys.path.insert(0, str(DOCS))  # for reference_pages

project = "rfca-rig"
version = release = rfca_rig.__version__
extensions = ["myst_nb", "reference_pages"]
exclude_patterns = ["examples"]

# Links to headings, as in mechanisms.md#files.
myst_heading_anchors = 4
nb_execution_mode = "cache"
# A diagnosis takes a minute of CPU time; machines of CI are slow and shared.
nb_execution_timeout = 1800
nb_execution_raise_on_error = nb_execution_in_temp = True
# `-t without_diagnosis` leaves out the longest notebook, whose cells have a test of their own.
# Sphinx provides `tags`.
if tags.has("without_diagnosis"):  # type: ignore[name-defined]  # noqa: F821
    nb_execution_excludepatterns = ["notebooks/first-run*"]
    # Only the kernel tells the language of the cells.
    suppress_warnings = ["myst-nb.lexer"]

# --view stays two hyphens.
smartquotes = False

html_theme = "furo"
html_title = f"rfca-rig {release}"
html_static_path = ["_static"]
html_css_files = ["wide-tables.css"]
# The sources are in the repository; without them the site is half as large.
html_copy_source = html_show_sourcelink = False
html_show_copyright = False


def setup(app: Sphinx) -> None:
    digest = digest_code()
    # Sphinx sees when a page has changed, not when the code has: as a value of the configuration,
    # the digest tells it.
    app.add_config_value("code_digest", digest, "env", types=frozenset({str}))
    caches = Path(app.outdir).parent / ".notebooks"
    app.config.nb_execution_cache_path = str(caches / digest)
    for cache in caches.glob("*"):
        if cache.name != digest:
            shutil.rmtree(cache)
    app.connect("build-finished", complete_html)


def digest_code() -> str:
    """Of everything that the notebooks run, with the versions of the packages."""
    sources = [path for folder in SOURCES for path in (ROOT / folder).rglob("*") if path.is_file()]
    sources.extend(DOCS.glob("*.py"))
    digest = hashlib.sha256()
    for path in sorted(sources):
        if path.suffix != ".pyc":
            digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    versions = {f"{package.name}=={package.version}" for package in distributions()}
    digest.update("\n".join(sorted([sys.version, *versions])).encode())
    return digest.hexdigest()[:16]


def complete_html(app: Sphinx, failure: Exception | None) -> None:
    """Adds what assistive software needs and Sphinx leaves out: the level of captions, and
    keyboard access to what scrolls.
    """
    missing = {
        'role="heading">': 'role="heading" aria-level="2">',
        "<pre>": '<pre tabindex="0">',
        '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
        '<div class="cell_output': '<div tabindex="0" class="cell_output',
    }
    if failure is None and app.builder.format == "html":
        for page in Path(app.outdir).rglob("*.html"):
            text = page.read_text(encoding="utf-8")
            for found, complete in missing.items():
                text = text.replace(found, complete)
            page.write_text(text, encoding="utf-8")

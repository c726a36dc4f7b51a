#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""The jobs of the repository, each in an environment of its own: `nox --list` names them.

`.ci/run` runs the same checks in one environment, and needs no nox.
"""

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv|virtualenv"

PINNED = ("--no-compile", "-c", "constraints.txt")
# What needs no socket, no helper process and no device: enough to use every dependency.
OFFLINE_TESTS = (
    "tests/codecs",
    "tests/protocol",
    "tests/description",
    "tests/model",
    "tests/vision",
    "tests/mechanism",
    "tests/campaign",
    "tests/recording",
    "tests/test_mechanics.py",
)


@nox.session
def static(session: nox.Session) -> None:
    """Style, types, layers, spelling, workflows, and the repository as a whole."""
    session.install(*PINNED, "-e", ".[dev,third-party-clients,docs,loggers,review]")
    session.run(".ci/static", external=True)


@nox.session
def tests(session: nox.Session) -> None:
    """The quick tests; `nox -s tests -- -m slow` for others."""
    session.install(*PINNED, "-e", ".[dev]")
    session.run("pytest", "-q", "-n", "auto", *session.posargs)


@nox.session(venv_backend="uv", python="3.11", default=False)
def floors(session: nox.Session) -> None:
    """Tests with the lowest versions that pyproject.toml allows, on the lowest Python."""
    session.install("--resolution", "lowest-direct", "-e", ".[dev,loggers]")
    # Old versions do not know what newer ones beside them have deprecated since.
    allowed = ("-W", "ignore::DeprecationWarning")
    session.run("pytest", "-q", "-n", "auto", *allowed, *(session.posargs or OFFLINE_TESTS))


@nox.session(default=False)
def tiled(session: nox.Session) -> None:
    """Runs as a catalogue of Tiled, with its newest version."""
    # Not pinned: its server needs an SQLAlchemy before 2.1, which is not the one of the site.
    session.install("-e", ".[tiled]", "pytest", "pytest-timeout", "pytest-xdist", "hypothesis")
    session.run("pytest", "-q", *(session.posargs or ("tests/notebook/test_tiled.py",)))


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """The documentation site in build/site."""
    session.install(*PINNED, "-e", ".[docs]")
    options = ("-W", "--keep-going", "-j", "auto", *session.posargs)
    session.run("python", "-m", "sphinx", *options, "docs", "build/site")


@nox.session(default=False)
def package(session: nox.Session) -> None:
    """Wheel and sdist in dist/."""
    session.install("build")
    session.run("python", "-m", "build")


if __name__ == "__main__":
    nox.main()

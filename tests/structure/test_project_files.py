"""Files beside the package: they agree with each other, and their links lead somewhere."""

import re
import tomllib
from pathlib import Path

import pytest

from rfca_rig import __version__
from tests.cli.test_eighty_columns import every_command

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PAGES = [
    *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CODE_OF_CONDUCT", "CONTRIBUTING", "SECURITY")),
    *(ROOT / "docs/decisions").glob("*.md"),
]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
HOOK_REPOSITORIES = {
    "astral-sh/ruff-pre-commit": "ruff",
    "codespell-project/codespell": "codespell",
    "zizmorcore/zizmor-pre-commit": "zizmor",
}
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
COMMAND = re.compile(r"`(?:rfca-rig )?([a-z]+(?: [a-z]+)?) --list`")


def test_one_version_for_the_package_its_metadata_and_its_citation():
    assert "version" in PROJECT["project"]["dynamic"]
    assert PROJECT["tool"]["hatch"]["version"]["path"] == "rfca_rig/__init__.py"
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_every_python_that_is_allowed_is_classified_and_tested():
    classified = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["project"]["classifiers"]))
    assert PROJECT["project"]["requires-python"] == f">={classified[0]}"
    workflow = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    assert str(classified).replace("'", '"') in workflow


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_the_workflows_pin_their_actions(workflow):
    used = re.findall(r"uses: (.*)", workflow.read_text(encoding="utf-8"))
    assert used and all(
        re.fullmatch(r"(actions|pypa)/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action)
        for action in used
    )


def test_only_a_tag_publishes_and_without_a_token():
    text = (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")
    build, publish = text.split("\n  publish:\n")
    assert "pypi-publish" not in build and "pypi-publish" in publish
    assert "if: github.ref_type == 'tag'" in publish
    assert "id-token: write" in publish and "attestations: true" in publish
    assert "id-token" not in build and "secrets." not in text and "password" not in text


def test_hooks_have_the_versions_that_are_pinned():
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    for repository, tool in HOOK_REPOSITORIES.items():
        version = re.search(rf"{repository}\n    rev: v([\d.]+)\n", hooks)[1]
        assert f"{tool}=={version}" in constraints


def test_the_jobs_name_paths_that_exist():
    jobs = (ROOT / "noxfile.py").read_text(encoding="utf-8")
    named = re.findall(r'"((?:tests|docs|\.ci)/[\w./]+|constraints\.txt)"', jobs)
    assert len(named) >= 10
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_one_list_of_static_checks_for_everyone():
    assert "in_idle_time .ci/static" in (ROOT / ".ci/run").read_text(encoding="utf-8")
    assert '".ci/static"' in (ROOT / "noxfile.py").read_text(encoding="utf-8")
    assert "`.ci/static`" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_the_workflow_names_paths_that_exist():
    workflow = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    commands = re.findall(r"run: (.*)", workflow)
    named = [
        word
        for command in commands
        for word in command.split()
        if word.startswith((".ci/", "tests/", "constraints"))
    ]
    assert len(named) >= 8
    assert [name for name in named if not (ROOT / name).exists()] == []
    # What a release is checked with by hand is what the workflow runs.
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert ".ci/run" in commands and "`.ci/run`" in contributing
    assert any("pytest -q -m long tests/test_packaging.py" in command for command in commands)
    assert "pytest -m long tests/test_packaging.py" in contributing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_of_the_pages_lead_somewhere(page):
    links = [
        link
        for link in LINK.findall(page.read_text(encoding="utf-8"))
        if not link.startswith("https://")
    ]
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_every_decision_is_in_the_list_and_has_its_three_parts():
    records = sorted((ROOT / "docs/decisions").glob("0*.md"))
    assert len(records) >= 10
    listed = LINK.findall((ROOT / "docs/decisions/README.md").read_text(encoding="utf-8"))
    assert listed == [record.name for record in records]
    for record in records:
        text = record.read_text(encoding="utf-8")
        assert re.findall(r"^\*\*(\w+)\.\*\*", text, re.MULTILINE) == [
            "Context",
            "Decision",
            "Consequences",
        ]


def test_the_change_log_names_commands_that_exist():
    named = COMMAND.findall((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert named
    assert {tuple(name.split()) for name in named} <= set(every_command())


def test_files_that_the_sdist_names_exist():
    included = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    assert [name for name in included if not (ROOT / name.lstrip("/")).exists()] == []

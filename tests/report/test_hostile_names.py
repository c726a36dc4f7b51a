"""Whole pages, programs and files with hostile names, by the writers of the real commands: a name
stays a name.

Names of models have no quotes and no control characters, other models are refused. Names of
conditions, columns, data sets and titles may be anything that a file can hold.
"""

import csv
import io
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.escaping import TURNS_DIRECTION, printable
from rfca_rig.reports.diagnosis.files import write_diagnosis
from rfca_rig.reports.provenance import Origin, PageContext, RecordingSource
from rfca_rig.reports.run.page import page as run_page
from rfca_rig.reports.run.page import tables_of
from rfca_rig.reports.run.parts import story_of
from rfca_rig.reports.strokes.page import write_report
from tests.cli.typed import typed_in
from tests.mechanism.arm import Arm, mjcf, record, write_campaign
from tests.report import runs
from tests.report.recordings import recording, stages, strokes
from tests.report.test_diagnosis_page import MECHANISM, NAMED

pytestmark = pytest.mark.slow

# What a model takes as the name of a joint.
MODEL_NAMES = (
    "<img src=x onerror=hostile()>",
    "</script><script>hostile()</script>",
    "</style></title><hostile>",
    "$\\hostile{",
    "&lt;hostile&gt; &amp; <!--",
    "]]> {{ 7 * 7 }} {% hostile %}",
    "ends with a backslash \\",
    "膝 ${HOME} %s {0}",
)
ANY_NAMES = (
    *MODEL_NAMES,
    '"><img src=x onerror=hostile()>',
    "' onmouseover='hostile()' x='",
    '"""\nimport hostile\n"""',
    "line\n[known_to]\nhostile = 1",
    "\x1b]0;hostile\x07\x9b2J\x7f",
    "\u202ehostile\u2066\u2028\u2029\x85",
)
UNPRINTABLE = {
    *map(chr, range(32)),
    *map(chr, range(127, 160)),
    *TURNS_DIRECTION,
    "\u2028",
    "\u2029",
} - {"\n", "\t"}


class Outline(HTMLParser):
    """Elements with the names of their attributes, programs and styles, and the text that a
    reader sees.
    """

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: set[tuple[str, ...]] = set()
        self.programs: list[str] = []
        self.comments: list[str] = []
        self.links: set[str] = set()
        self.text = ""
        self._within = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.add((tag, *sorted(name for name, _ in attrs)))
        self.links |= {
            value or "" for name, value in attrs if name in ("href", "src", "action", "xlink:href")
        }
        self._within = tag

    def handle_endtag(self, _tag: str) -> None:
        self._within = ""

    def handle_comment(self, data: str) -> None:
        self.comments.append(data)

    def handle_data(self, data: str) -> None:
        if self._within in ("script", "style"):
            self.programs.append(data)
        else:
            self.text += data


def check_page(page: str, harmless: str) -> Outline:
    """The page has elements of the harmless one only, its programs and styles, and no character
    that cannot be printed.
    """
    outline = Outline(page)
    usual = Outline(harmless)
    names = {tag for tag, *_ in outline.elements}
    assert names <= {tag for tag, *_ in usual.elements}
    assert not [
        attribute
        for _, *attributes in outline.elements
        for attribute in attributes
        if attribute.startswith("on")
    ]
    assert {name for _, *attributes in outline.elements for name in attributes} <= {
        name for _, *attributes in usual.elements for name in attributes
    }
    assert outline.comments == usual.comments
    assert "hostile" not in "".join(outline.programs)
    assert len(outline.programs) == len(usual.programs)
    assert not [
        link
        for link in outline.links
        if link.split(":")[0] in ("javascript", "vbscript", "data") and "hostile" in link
    ]
    assert not UNPRINTABLE & set(page)
    return outline


def rename(value: object, names: Mapping[str, str]) -> object:
    """The same result with other names in all of its texts, wherever they are."""
    if isinstance(value, str):
        for old, new in names.items():
            value = value.replace(old, new)
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "U":
            return np.array([rename(one, names) for one in value.tolist()])
        return value
    if isinstance(value, tuple | list):
        return type(value)(rename(one, names) for one in value)
    if isinstance(value, dict):
        return {rename(key, names): rename(one, names) for key, one in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return replace(
            value,
            **{
                field.name: rename(getattr(value, field.name), names)
                for field in fields(value)
                if field.init
            },
        )
    return value


def written_diagnosis(folder: Path, diagnosis: object, title: str) -> Path:
    if title:
        sources = (RecordingSource(f"runs/{title}", "0" * 64, "REAL", title, None, None, None),)
    else:
        sources = ()
    write_diagnosis(
        diagnosis, folder, Origin(command=f"rfca-rig diagnose {title}", recordings=sources)
    )
    return folder


def check_tables(folder: Path, harmless: Path) -> None:
    """Every table has the cells of the harmless one, and the JSON its keys."""
    for path in folder.glob("*.csv"):
        rows, usual = (
            list(csv.reader(io.StringIO(one.read_bytes().decode("utf-8"), newline="")))
            for one in (path, harmless / path.name)
        )
        assert [len(row) for row in rows] == [len(row) for row in usual]
    for path in folder.glob("*.tex"):
        text = path.read_text(encoding="utf-8")
        assert text.count("\\end{") == (harmless / path.name).read_text(encoding="utf-8").count(
            "\\end{"
        )
    assert {path.name for path in folder.iterdir()} == {path.name for path in harmless.iterdir()}


@pytest.fixture(scope="module")
def usual_diagnoses(tmp_path_factory) -> dict[str, Path]:
    """As the commands write them, with names that mean no harm."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ("leg", "mechanism")}
    written_diagnosis(folders["leg"], NAMED, "")
    written_diagnosis(folders["mechanism"], MECHANISM, "")
    return folders


@pytest.mark.parametrize("name", ANY_NAMES)
def test_a_diagnosis_of_conditions_with_hostile_names(tmp_path, usual_diagnoses, name):
    names = {
        "Leg 4 on the bench, March": name,
        "215 mm": f"215 mm {name}",
        "Repeat 3": name,
        "Law confirmed": name,
    }
    folder = written_diagnosis(tmp_path / "out", rename(NAMED, names), name)
    outline = check_page(
        (folder / "diagnosis.html").read_text(encoding="utf-8"),
        (usual_diagnoses["leg"] / "diagnosis.html").read_text(encoding="utf-8"),
    )
    assert " ".join(printable(name).split()) in " ".join(outline.text.split())
    check_tables(folder, usual_diagnoses["leg"])
    found = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["located"][0]["conditions"] == [
        condition.replace("215 mm", names["215 mm"]) for condition in NAMED.located[0].conditions
    ]


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_a_diagnosis_of_joints_with_hostile_names(tmp_path, usual_diagnoses, name):
    folder = written_diagnosis(
        tmp_path / "out",
        rename(MECHANISM, {"joint2": name, "link2": name, "Arm on the table": name}),
        name,
    )
    outline = check_page(
        (folder / "diagnosis.html").read_text(encoding="utf-8"),
        (usual_diagnoses["mechanism"] / "diagnosis.html").read_text(encoding="utf-8"),
    )
    assert " ".join(name.split()) in " ".join(outline.text.split())
    check_tables(folder, usual_diagnoses["mechanism"])
    found = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["located"][0]["signal"] == f"{name}_position_rad"


@pytest.fixture(scope="module")
def usual_report(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_report(
        (recording(strokes(), stages(), title="usual", provenance={"camera": "usual"}),), folder
    )
    return folder


@pytest.mark.parametrize("name", ANY_NAMES)
def test_a_report_of_strokes_with_a_hostile_title(tmp_path, usual_report, name):
    write_report(
        (recording(strokes(), stages(), title=name, provenance={"camera": name}),), tmp_path
    )
    for page in tmp_path.glob("*.html"):
        check_page(
            page.read_text(encoding="utf-8"), (usual_report / page.name).read_text(encoding="utf-8")
        )


@pytest.mark.parametrize("name", ANY_NAMES)
def test_the_page_of_a_run_with_a_hostile_title(name):
    pages = []
    for title in ("usual", name):
        story = story_of(rename(runs.tripped(), {"Table II": title}))
        pages.append(
            run_page(
                story, tables_of(story), PageContext(Origin(command=f"rfca-rig report {title}")), ()
            )
        )
    check_page(pages[1], pages[0])


def write_arm(folder: Path, names: Mapping[str, str]) -> Path:
    """Recordings of an arm, with other names for a joint, a motor, a column, and what the
    experiment states.
    """
    write_campaign(folder, Arm(), [record(Arm(), 1.6, 0)], {})
    text = mjcf(Arm())
    for old in ("joint2", "motor2", "link2"):
        text = text.replace(
            f'"{old}"', '"' + names[old].replace("&", "&amp;").replace("<", "&lt;") + '"'
        )
    (folder / "model.xml").write_text(text, encoding="utf-8")
    experiment = tomllib.loads((folder / "experiment.toml").read_text(encoding="utf-8"))
    (table,) = folder.glob("*.csv")
    head, rows = table.read_text(encoding="utf-8").split("\n", 1)
    columns = head.split(",")
    experiment["title"] = names["title"]
    for section in (*experiment["signals"], *experiment.get("commands", ())):
        for key in ("joint", "actuator"):
            if key in section:
                section[key] = names.get(section[key], section[key])
            else:
                section[key] = section.get(key)
        if section["column"] == columns[1]:
            section["column"] = names["column"]
    columns[1] = names["column"]
    with table.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(columns)
        file.write(rows)
    experiment["recordings"][0]["condition"] = names["condition"]
    (folder / "experiment.toml").write_text(_toml(experiment), encoding="utf-8")
    return folder


def _toml(value: Mapping[str, object]) -> str:
    """TOML by the rules of JSON, whose strings and lists TOML reads too; inline tables within
    lists.
    """
    return "".join(f"{json.dumps(key)} = {_inline(one)}\n" for key, one in value.items())


def _inline(value: object) -> str:
    if isinstance(value, dict):
        return (
            "{ "
            + ", ".join(
                f"{json.dumps(key)} = {_inline(one)}"
                for key, one in value.items()
                if one is not None
            )
            + " }"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    text = json.dumps(value)
    # TOML wants DEL escaped, and knows no halves of characters beyond 16 bits.
    return re.sub("\x7f", "\\\\u007f", text)


def reported(place: Path, model_name: str, name: str) -> Path:
    """The folder of the report that the command writes."""
    words = {"joint2": f"{model_name} j", "motor2": f"{model_name} m", "link2": f"{model_name} l"}
    # The head of a table is one line, without blanks at its end: a column with line breaks is
    # refused.
    column = f"c{' '.join(name.splitlines())}".strip()
    write_arm(place / "arm", {**words, "title": name, "column": column, "condition": name})
    done = typed_in(place, "report", place / "arm")
    assert done.exit_code == 0, done.err
    assert not UNPRINTABLE & set(done.out + done.err) - {"\r", "\x1b"}
    return place / "report"


@pytest.fixture(scope="module")
def usual_arm_report(tmp_path_factory) -> Path:
    return reported(tmp_path_factory.mktemp("usual"), "usual", "usual")


@pytest.mark.parametrize(
    ("model_name", "name"),
    [(MODEL_NAMES[k % len(MODEL_NAMES)], ANY_NAMES[k]) for k in range(len(ANY_NAMES))],
)
def test_the_report_of_a_mechanism_with_hostile_names(tmp_path, usual_arm_report, model_name, name):
    folder = reported(tmp_path, model_name, name)
    page = (folder / "report.html").read_text(encoding="utf-8")
    outline = check_page(page, (usual_arm_report / "report.html").read_text(encoding="utf-8"))
    assert " ".join(f"{model_name} j".split()) in " ".join(outline.text.split())


@pytest.mark.parametrize(
    ("model_name", "name"),
    [(MODEL_NAMES[k % len(MODEL_NAMES)], ANY_NAMES[k]) for k in range(len(ANY_NAMES))],
)
def test_the_draft_of_an_experiment_with_hostile_data_sets(tmp_path, model_name, name):
    """By `init`, of a model and of recordings in HDF5, whose data sets may have any name without
    a slash or a zero.
    """
    data = tmp_path / "data"
    data.mkdir()
    quoted = model_name.replace("&", "&amp;").replace("<", "&lt;")
    (tmp_path / "model.xml").write_text(
        mjcf(Arm()).replace('"joint2"', f'"{quoted}"').replace('"motor2"', f'"{quoted}"'),
        encoding="utf-8",
    )
    column = name.replace("/", "|").replace("\0", "")
    with h5py.File(data / "run.h5", "w") as file:
        file["t"] = np.arange(300) * 0.002
        file[column] = np.zeros(300)
    done = typed_in(tmp_path, "init", "--mjcf", tmp_path / "model.xml", "--data", data)
    assert done.exit_code == 0, done.err
    assert not UNPRINTABLE & set(done.out + done.err) - {"\r", "\x1b"}
    (draft,) = tmp_path.rglob("experiment.toml")
    written = tomllib.loads(draft.read_text(encoding="utf-8"))
    assert set(written) <= {
        "format",
        "title",
        "model",
        "time",
        "signals",
        "commands",
        "known_to",
        "recordings",
    }
    assert model_name in [signal.get("joint") for signal in written["signals"]]
    assert model_name in [command.get("actuator") for command in written["commands"]]
    assert "hostile" not in written["known_to"]


def test_the_check_finds_what_it_is_for():
    """Each of the ways out of a text is one that the check would see."""
    usual = '<html><title>t</title><p class="a">x</p><script>1</script></html>'
    for page in (
        usual.replace("x", "<img src=x>"),
        usual.replace('class="a"', 'class="a" onclick="hostile()"'),
        usual.replace("1", "hostile()"),
        usual.replace("x", "<!-- x -->"),
        usual.replace("x", "\x1b[2J"),
    ):
        with pytest.raises(AssertionError):
            check_page(page, usual)
    check_page(usual.replace("x", "&lt;hostile&gt;"), usual)

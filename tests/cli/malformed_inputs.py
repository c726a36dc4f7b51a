# ruff: noqa: E501  (tables of cases, one a line)
"""Malformed input files and arguments from a seed, and what every command owes them.

A case is a folder with a mutated file, or a strange argument, and a command typed there. It must
end in one line and exit code 2 with nothing written, or in a normal result where the input happens
to be legal.
"""

import contextlib
import io
import os
import random
import resource
import shutil
import signal
import stat
import sys
import time
import unicodedata
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.cli.main import run

ROOT = Path(__file__).parents[2]
# Address space beyond what the process has at the beginning of a case; a legal case of these takes
# less than 200 MB.
HEADROOM_BYTES = 1 << 30
# A legal case takes 3 s of a processor. The other limit ends what waits for something that never
# comes, on a busy machine too.
LONGEST_CPU_S = 60
LONGEST_S = 300
LONGEST_LINE = 1000

Words = tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """A command, typed in a folder that `prepare` fills.

    `failures` are exit codes other than 0 and 2 that it may have, as 1 where nothing can be written
    and 3 where a run trips.
    """

    label: str
    words: Words
    prepare: Callable[[Path], None]
    failures: tuple[int, ...] = ()


@dataclass(frozen=True)
class Subject:
    """A file that people write, at `path` in a folder filled from `sources`, and a command that
    reads it.
    """

    name: str
    sources: tuple[str, ...]
    path: str
    words: Words
    failures: tuple[int, ...] = ()

    @property
    def kind(self) -> str:
        return Path(self.path).suffix.lstrip(".")


SUBJECTS = (
    Subject(
        "rig",
        ("calibration",),
        "calibration/twin.toml",
        ("plan", "flapping", "--rig", "./calibration/twin.toml"),
    ),
    Subject(
        "real rig",
        ("tests/data/real-rig.toml",),
        "real-rig.toml",
        ("plan", "table2", "--rig", "./real-rig.toml"),
    ),
    Subject(
        "rig of a dry run",
        ("calibration",),
        "calibration/twin-daq.toml",
        ("dynamic", "run", "--dry-run", "--rig", "./calibration/twin-daq.toml"),
    ),
    Subject(
        "force sensor",
        ("calibration",),
        "calibration/made-up-gamma.cal",
        ("plan", "flapping", "--rig", "./calibration/twin-daq.toml"),
    ),
    Subject(
        "camera",
        ("calibration",),
        "calibration/twin-camera.toml",
        ("static", "run", "--dry-run", "--rig", "./calibration/twin.toml"),
    ),
    Subject(
        "flapping protocol",
        ("protocols",),
        "protocols/flapping.toml",
        ("plan", "./protocols/flapping.toml"),
    ),
    Subject(
        "table2 protocol",
        ("protocols",),
        "protocols/table2.toml",
        ("dynamic", "run", "--dry-run", "--protocol", "./protocols/table2.toml"),
    ),
    Subject(
        "fatigue protocol",
        ("protocols",),
        "protocols/fatigue.toml",
        ("fatigue", "run", "--dry-run", "--protocol", "./protocols/fatigue.toml"),
    ),
    Subject(
        "static protocol",
        ("protocols",),
        "protocols/static-angle.toml",
        ("static", "run", "--dry-run", "--protocol", "./protocols/static-angle.toml"),
    ),
    Subject(
        "bending protocol",
        ("protocols",),
        "protocols/bending.toml",
        ("plan", "./protocols/bending.toml"),
    ),
    Subject(
        "impact protocol",
        ("protocols",),
        "protocols/impact.toml",
        ("plan", "./protocols/impact.toml"),
    ),
    Subject(
        "campaign",
        ("tests/data/small-campaign",),
        "small-campaign/campaign.toml",
        ("import", "small-campaign", "--out", "imported"),
    ),
    Subject(
        "stroke",
        ("tests/data/small-campaign",),
        "small-campaign/runs/dynamic-02.csv",
        ("import", "small-campaign", "--out", "imported"),
    ),
    Subject(
        "static table",
        ("tests/data/small-campaign",),
        "small-campaign/runs/static.csv",
        ("check", "small-campaign"),
    ),
    Subject(
        "pendulum",
        ("tests/data/pendulums/free-swing",),
        "free-swing/pendulum.toml",
        ("import", "free-swing", "--out", "imported"),
    ),
    Subject(
        "swing",
        ("tests/data/pendulums/free-swing",),
        "free-swing/runs/release-90.csv",
        ("import", "free-swing", "--out", "imported"),
    ),
    Subject("experiment", (), "cart/experiment.toml", ("check", "cart")),
    Subject("mechanism's recording", (), "cart/a.csv", ("check", "cart")),
    Subject(
        "drafted recording",
        (),
        "cart/a.csv",
        ("init", "--mjcf", "cart/model.xml", "--data", "cart"),
    ),
    Subject(
        "sweep",
        ("sweeps",),
        "sweeps/height-and-speed.toml",
        ("sweep", "./sweeps/height-and-speed.toml", "--dry-run"),
    ),
    Subject(
        "sweep of materials",
        ("sweeps",),
        "sweeps/materials.toml",
        ("sweep", "./sweeps/materials.toml", "--dry-run"),
    ),
    Subject(
        "model",
        (),
        "model.toml",
        ("predict", "--height", "215", "--speed", "2.433", "--model", "./model.toml"),
    ),
    Subject(
        "model of a shape",
        (),
        "model.toml",
        ("static", "load", "--down", "10", "--model", "./model.toml"),
    ),
    Subject(
        "curve",
        (),
        "curve.csv",
        ("predict", "--height", "215", "--speed", "2.433", "--model", "./curve-model.toml"),
    ),
    Subject(
        "rig that runs",
        ("calibration",),
        "calibration/twin.toml",
        (
            "dynamic",
            "run",
            "--height",
            "235",
            "--speed",
            "3.2",
            "--repeats",
            "1",
            "--rig",
            "./calibration/twin.toml",
        ),
        (1, 3),
    ),
    Subject(
        "rig that is served",
        ("calibration",),
        "calibration/twin.toml",
        (
            "twin",
            "serve",
            "--seconds",
            "0.01",
            "--rig",
            "./calibration/twin.toml",
            *(f"--{name}-port=0" for name in ("rdt", "http", "command", "can", "control")),
        ),
    ),
    Subject(
        "rig of a strip",
        ("calibration",),
        "calibration/twin.toml",
        ("strip", "--rig", "./calibration/twin.toml"),
    ),
    Subject(
        "rig of a shape",
        ("calibration",),
        "calibration/twin.toml",
        ("static", "force", "--angles", "90,5,5,5,5,5,5", "--rig", "./calibration/twin.toml"),
    ),
    Subject(
        "rig of a sweep",
        ("calibration",),
        "calibration/twin.toml",
        (
            "sweep",
            "--vary",
            "height_mm=215,235",
            "--outputs",
            "energy_J",
            "--rig",
            "./calibration/twin.toml",
            "--dry-run",
        ),
    ),
    Subject(
        "camera of photos",
        ("calibration", "tests/data/small-campaign"),
        "calibration/twin-camera.toml",
        (
            "static",
            "photos",
            "small-campaign",
            "calibration",
            "--camera",
            "./calibration/twin-camera.toml",
        ),
    ),
    Subject(
        "reported stroke",
        ("tests/data/small-campaign",),
        "small-campaign/runs/dynamic-03.csv",
        ("report", "small-campaign", "--out", "report"),
    ),
    Subject(
        "reported campaign",
        ("tests/data/small-campaign",),
        "small-campaign/campaign.toml",
        ("report", "small-campaign", "--out", "report"),
    ),
    Subject(
        "reported stages",
        ("tests/data/small-campaign",),
        "small-campaign/runs/static.csv",
        ("static", "report", "small-campaign", "--out", "report"),
    ),
    Subject("listed experiment", (), "cart/experiment.toml", ("runs", "--runs", ".")),
    Subject(
        "listed campaign",
        ("tests/data/small-campaign",),
        "small-campaign/campaign.toml",
        ("runs", "--runs", "."),
    ),
    Subject("mechanism", (), "cart/model.xml", ("check", "cart")),
    Subject(
        "mechanism of a draft",
        (),
        "cart/model.xml",
        ("init", "--mjcf", "cart/model.xml", "--data", "cart"),
    ),
    Subject(
        "cluster",
        (),
        "cluster.toml",
        (
            "sweep",
            "--vary",
            "height_mm=215:216:2",
            "--outputs",
            "energy_J",
            "--cluster",
            "./cluster.toml",
        ),
    ),
)

EXPERIMENT = """format = "rfca-experiment/1"
title = "cart"
model = "model.xml"
time = { column = "t", unit = "ms" }
[[signals]]
joint = "cart"
quantity = "position"
column = "x"
unit = "mm"
sign = -1
noise_std = 0.5
[[signals]]
joint = "cart"
quantity = "speed"
column = "v"
unit = "mm/s"
[[commands]]
actuator = "push"
column = "force"
unit = "N"
[known_to]
mass_relative = 0.02
[[recordings]]
file = "a.csv"
condition = "slow"
"""
MECHANISM = """<mujoco><option timestep="0.001"/><worldbody><body><joint name="cart" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody>
<actuator><motor name="push" joint="cart"/></actuator></mujoco>"""
CART = "t,x,v,force\n" + "".join(f"{k},{-0.0005 * k * k:.6f},{-k:.3f},1\n" for k in range(1200))
CLUSTER = (
    'scheduler = "slurm"\njobs = 2\nworkers_per_job = 4\ntime = "10:00"\npartition = '
    '"short"\nsetup = ["true"]\noptions = ["--exclusive"]\n'
)
CURVE = "angle_deg,torque_Nm,torque_std_Nm\n3.0,0.581,0.006\n6.0,1.210,0.008\n10.0,2.187,0.010\n15.0,3.776,0.016\n25.0,8.1,0.05\n"


def _fill(folder: Path, subject: Subject) -> None:
    """The subject's own files, whole."""
    for source in subject.sources:
        if (ROOT / source).is_dir():
            copy = shutil.copytree
        else:
            copy = shutil.copy
        copy(ROOT / source, folder / Path(source).name)
    if subject.path.startswith("cart/"):
        (folder / "cart").mkdir()
        for name, text in (
            ("experiment.toml", EXPERIMENT),
            ("model.xml", MECHANISM),
            ("a.csv", CART),
        ):
            (folder / "cart" / name).write_text(text, encoding="utf-8")
        if subject.words[0] == "init":
            (folder / "cart" / "experiment.toml").unlink()
    twin = (ROOT / "calibration" / "twin.toml").read_text(encoding="utf-8")
    model = "[leg]" + twin.partition("[leg]")[2].partition("[limits]")[0]
    law = ("hinge_torque_Nm", "k0_Nm", "k2_per")
    curve = "".join(line for line in model.splitlines(keepends=True) if not line.startswith(law))
    curve = curve.replace("[ground]", '[leg.torque_rotation]\ncurve = "curve.csv"\n\n[ground]', 1)
    for name, text in (
        ("model.toml", model),
        ("curve-model.toml", curve),
        ("curve.csv", CURVE),
        ("cluster.toml", CLUSTER),
    ):
        (folder / name).write_text(text, encoding="utf-8")


# -- mutations of a text
# --------------------------------------------------------------------------------------------------

TOML_VALUES = (
    '"text"',
    '""',
    "true",
    "[]",
    "{}",
    "[1, 2]",
    "[[1.0], [2.0]]",
    '["a"]',
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "-0.0",
    "1e300",
    "1e-300",
    "5e-324",
    "-1e300",
    "99999999999999999999",
    "9223372036854775808",
    "1979-05-27",
    "07:32:00",
    "1979-05-27T07:32:00Z",
    '"215 mm"',
    '"nan"',
    '"1.0"',
    '"\\u001b]0;owned\\u0007"',
    '"a\\u0000b"',
    '"a\\nb"',
    '"\\u202etxt.exe"',
    "[" * 40 + "]" * 40,
    "{a={a={a={a={a=1}}}}}",
    "215,0",
    "1_000",
    "0x10",
    "+5",
    "1.",
    "'/dev/zero'",
    "'../../../../etc/passwd'",
    "'.'",
    "'/'",
    "1e7",
    "1e-7",
    "[nan, nan, nan, nan, nan, nan, nan]",
    "[1e300, 1e300, 1e300, 1e300, 1e300, 1e300, 1e300]",
    "1e9",
    "1000000000",
    "-5",
    "1000",
    "0.001",
)
CSV_CELLS = (
    "",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "text",
    "1e300",
    "-1e300",
    "1e-300",
    "1e999",
    "1,5",
    "1;5",
    '"1,5"',
    '"unclosed',
    "0x10",
    "1_000",
    "#N/A",
    "--5",
    "5 mm",
    "\t",
    "\x1b[2J",
    "\x00",
    "é",
    "9" * 200,
    "9" * 200_000,
    "x" * 200_000,
    "1.5.2",
    "∞",
    "٣",
    "True",
    "2026-11-01",
    "1e",
    "+",
    "-0",
    "1979-05-27T07:32:00Z",
    "1e10",
    "1e17",
)
XML_VALUES = (
    "",
    "text",
    "nan",
    "inf",
    "-1",
    "0",
    "1e300",
    "1e-300",
    "1 2 3",
    "1 2 3 4 5 6 7",
    "nan nan nan nan nan nan",
    "0 0 0 0 0 0",
    "1e300 0 0 0 0 0",
    "lb",
    "kg",
    "True",
    "N",
    "9" * 400,
    "\x1b]0;owned\x07",
    "é",
    "&#27;",
    "&unknown;",
)


def _change_line(
    wanted: Callable[[str], bool], change: Callable[[random.Random, str], str]
) -> Callable[[random.Random, str], str]:
    def mutate(chance: random.Random, text: str) -> str:
        lines = text.split("\n")
        places = [place for place, line in enumerate(lines) if wanted(line)]
        if places:
            place = chance.choice(places)
            lines[place] = change(chance, lines[place])
        return "\n".join(lines)

    return mutate


def _is_key(line: str) -> bool:
    return "=" in line and not line.lstrip().startswith(("#", "[", "<"))


def _is_header(line: str) -> bool:
    return line.startswith("[")


def _misspell(chance: random.Random, line: str) -> str:
    letters = [place for place, letter in enumerate(line) if letter.isalpha()] or [0]
    place = chance.choice(letters)
    return (
        line[:place]
        + chance.choice(("", "x", line[place : place + 1] * 2, "é", " ", "."))
        + line[place + 1 :]
    )


def _change_number(chance: random.Random, line: str) -> str:
    key, _, value = line.partition("=")
    words = value.split()
    places = [place for place, word in enumerate(words) if _has_digit(word)]
    if places:
        place = chance.choice(places)
        end = "".join(letter for letter in words[place] if letter in ",]}")
        words[place] = (
            chance.choice(
                ("nan", "inf", "-1", "0", "1e300", "1e-300", '"1"', "true", "1e6", "-1e-3", "")
            )
            + end
        )
    return f"{key}= {' '.join(words)}"


def _has_digit(word: str) -> bool:
    return any(letter.isdigit() for letter in word)


def _without_section(chance: random.Random, text: str) -> str:
    head, *sections = text.split("\n[")
    if sections:
        sections.pop(chance.randrange(len(sections)))
    return "\n[".join((head, *sections))


TOML_MUTATIONS: tuple[tuple[str, Callable[[random.Random, str], str]], ...] = (
    (
        "value",
        _change_line(
            _is_key, lambda chance, line: f"{line.partition('=')[0]}= {chance.choice(TOML_VALUES)}"
        ),
    ),
    (
        "value",
        _change_line(
            _is_key, lambda chance, line: f"{line.partition('=')[0]}= {chance.choice(TOML_VALUES)}"
        ),
    ),
    (
        "value",
        _change_line(
            _is_key, lambda chance, line: f"{line.partition('=')[0]}= {chance.choice(TOML_VALUES)}"
        ),
    ),
    ("number", _change_line(_is_key, _change_number)),
    ("number", _change_line(_is_key, _change_number)),
    (
        "huge text",
        _change_line(_is_key, lambda _, line: f"{line.partition('=')[0]}= '{'x' * 200_000}'"),
    ),
    (
        "huge array",
        _change_line(_is_key, lambda _, line: f"{line.partition('=')[0]}= [{'0.1, ' * 200_000}]"),
    ),
    ("missing key", _change_line(_is_key, lambda _, _line: "")),
    ("duplicated key", _change_line(_is_key, lambda _, line: f"{line}\n{line}")),
    ("misspelt key", _change_line(_is_key, _misspell)),
    (
        "extra key",
        _change_line(
            _is_header,
            lambda chance, line: (
                f"{line}\n{chance.choice(('extra', 'é', chr(34) + chr(92) + 'u001b[2J' + chr(34)))} "
                "= 1"
            ),
        ),
    ),
    ("misspelt table", _change_line(_is_header, _misspell)),
    ("missing table", _change_line(_is_header, lambda _, _line: "")),
    ("doubled table", _change_line(_is_header, lambda _, line: f"{line}\n{line}")),
    (
        "table as list",
        _change_line(_is_header, lambda _, line: f"[{line.partition('#')[0].strip()}]"),
    ),
    ("deep key", _change_line(_is_key, lambda _, line: f"{'a.' * 5000}a = 1\n{line}")),
    ("deep table", _change_line(_is_header, lambda _, line: f"[{'a.' * 5000}a]\nb = 1\n{line}")),
    ("no section", _without_section),
)


def _change_cell(chance: random.Random, line: str) -> str:
    cells = line.split(",")
    cells[chance.randrange(len(cells))] = chance.choice(CSV_CELLS)
    return ",".join(cells)


def _header(
    change: Callable[[random.Random, list[str]], list[str]],
) -> Callable[[random.Random, str], str]:
    def mutate(chance: random.Random, text: str) -> str:
        first, _, rest = text.partition("\n")
        return ",".join(change(chance, first.split(","))) + "\n" + rest

    return mutate


def _rename(chance: random.Random, names: list[str]) -> list[str]:
    place = chance.randrange(len(names))
    name = names[place]
    names[place] = chance.choice(
        (
            "",
            "x",
            name.upper(),
            f"{name} [kN]",
            f"{name}_mm",
            "\x1b[2J",
            name * 40_000,
            f'"{name}',
            "é",
            names[0],
            "1.5",
        )
    )
    return names


def _any(_line: str) -> bool:
    return True


def _swapped(chance: random.Random, text: str) -> str:
    head, *rows = text.strip().split("\n")
    one, other = (chance.randrange(max(len(rows), 1)) for _ in range(2))
    if rows:
        rows[one], rows[other] = rows[other], rows[one]
    return "\n".join([head, *rows])


CSV_MUTATIONS: tuple[tuple[str, Callable[[random.Random, str], str]], ...] = (
    ("cell", _change_line(_any, _change_cell)),
    ("cell", _change_line(_any, _change_cell)),
    ("cell", _change_line(_any, _change_cell)),
    (
        "ragged",
        _change_line(
            _any,
            lambda chance, line: chance.choice(
                (line + ",1", line.rpartition(",")[0], "," * 50, line * 2)
            ),
        ),
    ),
    ("huge row", _change_line(_any, lambda _, line: line + "," * 500_000)),
    ("column name", _header(_rename)),
    ("column missing", _header(lambda _, names: names[:-1])),
    ("column twice", _header(lambda _, names: [*names, names[-1]])),
    ("semicolons", lambda _, text: text.replace(",", ";")),
    ("tabs", lambda _, text: text.replace(",", "\t")),
    ("decimal comma", lambda _, text: text.replace(",", ";").replace(".", ",")),
    ("only header", lambda _, text: text.partition("\n")[0]),
    ("no header", lambda _, text: text.partition("\n")[2]),
    ("few rows", lambda chance, text: "\n".join(text.split("\n")[: chance.randrange(1, 6)])),
    ("empty rows", _change_line(_any, lambda _, line: f"{line}\n\n\n")),
    ("row twice", _change_line(_any, lambda _, line: f"{line}\n{line}")),
    ("rows swapped", _swapped),
    ("quoted", lambda _, text: text.replace(",", '","')),
    (
        "all one value",
        lambda _, text: text.partition("\n")[0] + ("\n" + "".join(text.split("\n")[1:2])) * 20,
    ),
)


def _change_attribute(chance: random.Random, text: str) -> str:
    parts = text.split('"')
    place = chance.randrange(1, len(parts), 2)
    parts[place] = chance.choice(XML_VALUES)
    return '"'.join(parts)


XML_MUTATIONS: tuple[tuple[str, Callable[[random.Random, str], str]], ...] = (
    ("attribute", _change_attribute),
    ("attribute", _change_attribute),
    ("attribute", _change_attribute),
    ("missing line", _change_line(_any, lambda _, _line: "")),
    ("line twice", _change_line(_any, lambda _, line: f"{line}\n{line}")),
    ("misspelt", _change_line(_any, _misspell)),
    ("deep", _change_line(_any, lambda _, line: f"{line}{'<a>' * 100_000}")),
    ("entities", lambda _, text: '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>' + text),
    (
        "huge attribute",
        _change_line(_any, lambda _, line: line.replace('="', f'="{"1 " * 100_000}', 1)),
    ),
)


def _flip(chance: random.Random, content: bytes) -> bytes:
    changed = bytearray(content)
    for _ in range(chance.randrange(1, 8)):
        changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def _insert(what: bytes) -> Callable[[random.Random, bytes], bytes]:
    def mutate(chance: random.Random, content: bytes) -> bytes:
        place = chance.randrange(len(content))
        return content[:place] + what + content[place:]

    return mutate


BYTE_MUTATIONS: tuple[tuple[str, Callable[[random.Random, bytes], bytes]], ...] = (
    ("empty", lambda _, _content: b""),
    ("only blanks", lambda _, _content: b" \n\t\n"),
    ("byte-order mark", lambda _, content: b"\xef\xbb\xbf" + content),
    ("UTF-16", lambda _, content: content.decode("utf-8").encode("utf-16")),
    ("UTF-32", lambda _, content: content.decode("utf-8").encode("utf-32")),
    ("Latin-1", lambda _, content: content.replace(b"e", b"\xe9", 3)),
    ("NUL", _insert(b"\0")),
    ("escape", _insert(b"\x1b]0;owned\x07")),
    ("surrogates", _insert(b"\xed\xa0\x80")),
    ("CRLF", lambda _, content: content.replace(b"\n", b"\r\n")),
    ("CR", lambda _, content: content.replace(b"\n", b"\r")),
    ("cut", lambda chance, content: content[: chance.randrange(len(content))]),
    ("cut", lambda chance, content: content[: chance.randrange(len(content))]),
    ("flipped", _flip),
    ("flipped", _flip),
    ("binary", lambda chance, _content: chance.randbytes(5000)),
    ("HDF5", lambda _, _content: b"\x89HDF\r\n\x1a\n" + bytes(200)),
    ("zip", lambda _, _content: b"PK\x03\x04" + bytes(200)),
    ("twice", lambda _, content: content + b"\n" + content),
    ("JSON", lambda _, _content: b'{"a": [1, 2, {"b": null}]}'),
    ("brackets", lambda _, _content: b"a = " + b"[" * 50_000),
    ("braces", lambda _, _content: b"a = " + b"{a=" * 50_000),
    ("no end of line", lambda _, content: content.replace(b"\n", b" ")),
)
MUTATIONS = {
    "toml": TOML_MUTATIONS,
    "csv": CSV_MUTATIONS,
    "cal": XML_MUTATIONS,
    "xml": XML_MUTATIONS,
}


# -- files that are none
# --------------------------------------------------------------------------------------------------


def _as_folder(path: Path) -> None:
    path.mkdir()


def _as_large(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(5_000_000_000)


PLACES: tuple[tuple[str, Callable[[Path], None]], ...] = (
    ("missing", lambda _path: None),
    ("folder", _as_folder),
    ("pipe", os.mkfifo),
    ("loop", lambda path: path.symlink_to(path.name)),
    ("dangling", lambda path: path.symlink_to("nowhere")),
    ("/dev/zero", lambda path: path.symlink_to("/dev/zero")),
    ("/dev/full", lambda path: path.symlink_to("/dev/full")),
    ("/dev/null", lambda path: path.symlink_to("/dev/null")),
    ("/proc/self/mem", lambda path: path.symlink_to("/proc/self/mem")),
    ("5 GB", _as_large),
)


def _file_case(chance: random.Random) -> Case:
    """A subject with one or two mutations."""
    subject = chance.choice(SUBJECTS)
    seed = chance.getrandbits(64)
    draw = chance.random()
    if draw < 0.08:
        name, make = chance.choice(PLACES)

        def replace(folder: Path) -> None:
            _fill(folder, subject)
            (folder / subject.path).unlink()
            make(folder / subject.path)

        return Case(f"{subject.name}: {name}", subject.words, replace, subject.failures)
    of_bytes = chance.choice(BYTE_MUTATIONS) if draw < 0.3 else None
    of_text = [
        chance.choice(MUTATIONS[subject.kind])
        for _ in range(0 if of_bytes else chance.choice((1, 1, 1, 2)))
    ]

    def mutate(folder: Path) -> None:
        _fill(folder, subject)
        inner = random.Random(seed)
        path = folder / subject.path
        text = path.read_text(encoding="utf-8")
        for _, change in of_text:
            text = change(inner, text)
        content = text.encode("utf-8", "surrogatepass")
        path.write_bytes(of_bytes[1](inner, content) if of_bytes else content)

    if of_bytes:
        names = [of_bytes[0]]
    else:
        names = [name for name, _ in of_text]
    return Case(f"{subject.name}: {', '.join(names)}", subject.words, mutate, subject.failures)


# -- arguments
# --------------------------------------------------------------------------------------------------

NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "-0",
    "1e-300",
    "5e-324",
    "1e300",
    "1e-7",
    "1e7",
    "1e999",
    "text",
    "",
    " ",
    "1,5",
    "0x10",
    "1_000",
    "--",
    "٣",
    "215 mm",
    "9" * 400,
    "1e",
    "\x1b[2J",
    "None",
    "1.5",
    "99999999999999999999",
    "-99999999999999999999",
)
TEXTS = (
    "",
    " ",
    "\x1b]0;owned\x07",
    "a\nb",
    "\u202etxt",
    "x" * 100_000,
    "é",
    "\udcff",
    "=",
    "==",
    ",",
    ",,,",
    "..",
    "/",
    "@",
    "nan",
    "a=b=c",
    "\x85",
    "🦿",
    "'; rm -rf x",
    "${HOME}",
    "%s%n",
    "{0}",
    "[bold]",
    "a" * 300,
)
PATHS = (
    "",
    " ",
    ".",
    "..",
    "missing",
    "missing/",
    "missing/deeper/still.toml",
    "./missing.toml",
    "folder",
    "./folder.toml",
    "pipe",
    "./pipe.toml",
    "loop",
    "./loop.toml",
    "loop/below",
    "/dev/zero",
    "/dev/full",
    "/dev/null",
    "/dev/stdin",
    "/proc/self/mem",
    "/sys/kernel",
    "\x1b[2J",
    "./\x1b[2J.toml",
    "\udcff",
    "./\udcff.toml",
    "x" * 300,
    "./" + "x" * 300 + ".toml",
    "y/" * 3000 + "z.toml",
    "empty",
    "./empty.toml",
    "./empty.csv",
    "./noise.h5",
    "noise.h5",
    "file/below",
    "a\nb",
    "é",
    "-",
    "~",
    "http://localhost/x.toml",
    "🦿",
)
# No device and no folder of the machine: an administrator's command that writes there by mistake
# would replace it for everybody.
OUTPUTS = (
    "",
    "/dev/null/x",
    "/proc/x",
    "/sys/x",
    "/proc/self/x/y",
    "empty",
    "file/below",
    "loop",
    "loop/below",
    "pipe",
    "folder",
    "x" * 300,
    "y/" * 3000 + "z",
    "\x1b[2J",
    "\udcff",
    ".",
    "dangling",
)
HEIGHT_SPEED = ("--height", "215", "--speed", "2.433")
RUN = "imported"

# A command, an argument to replace by @, and what to put there. `run` stands for a recording.
ARGUMENTS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("dynamic run --dry-run --height @ --speed 2", NUMBERS),
    ("dynamic run --dry-run --height 215 --speed @", NUMBERS),
    ("dynamic run --dry-run --height 215 --speed 2 --repeats @", NUMBERS),
    ("dynamic run --dry-run --protocol @", PATHS),
    ("dynamic run --dry-run --rig @", PATHS),
    ("dynamic run --dry-run --model @", PATHS),
    ("dynamic run --dry-run --runs @", OUTPUTS),
    ("dynamic run --dry-run --seed @", NUMBERS),
    (
        "dynamic run --dry-run --fault @",
        (
            *TEXTS,
            "force-silent@nan",
            "force-silent@-1",
            "force-silent@5-2",
            "force-silent@1e300",
            "force-silent@inf",
            "x@1",
        ),
    ),
    ("dynamic run --dry-run --view-port @", NUMBERS),
    ("dynamic run --dry-run --pace @", NUMBERS),
    ("dynamic run --dry-run --operator @", TEXTS),
    ("dynamic run --dry-run --sample @", TEXTS),
    ("dynamic run --dry-run --@ 1", ("heigth", "sped", "x" * 10_000, "\x1b[2J", "é", "=", "")),
    ("static run --dry-run --protocol @", PATHS),
    ("fatigue run --dry-run --cycles @", NUMBERS),
    ("fatigue run --dry-run --protocol @", PATHS),
    ("plan @", (*PATHS, *TEXTS)),
    ("plan flapping --rig @", PATHS),
    ("plan flapping --model @", PATHS),
    ("predict --height @ --speed 2", NUMBERS),
    ("predict --height 215 --speed @", NUMBERS),
    ("predict --height 215 --speed 2 --sweep @", NUMBERS),
    ("predict --height 215 --speed 2 --model @", PATHS),
    ("predict --height 215 --speed 2 --csv @", OUTPUTS),
    ("strip --height @", NUMBERS),
    ("strip --speed @", NUMBERS),
    ("import @", PATHS),
    ("import campaign --out @", OUTPUTS),
    ("check @", PATHS),
    ("recover @", PATHS),
    ("resume @ --dry-run", PATHS),
    ("report @", PATHS),
    ("report run --out @", OUTPUTS),
    ("report run --out out --model @", PATHS),
    ("fit @", PATHS),
    ("fit run --parameters @", TEXTS),
    ("fit run --phases @", TEXTS),
    ("fit run --after-touchdown @", NUMBERS),
    ("fit run --starts @", ("nan", "-1", "0", "65", "text", "1e3", "")),
    ("fit run --out @", OUTPUTS),
    ("diagnose @", PATHS),
    ("diagnose run --without @", TEXTS),
    ("view @", PATHS),
    ("view empty --port @", NUMBERS),
    ("runs @", TEXTS),
    ("runs --runs @", PATHS),
    ("runs --height @", (*NUMBERS, "1..", "..", "5..1", "nan..inf", "1..2..3")),
    ("runs --speed @", NUMBERS),
    (
        "runs --since @",
        (
            *TEXTS,
            "2026-13-01",
            "2026-02-30",
            "0000-00-00",
            "9999-12-31",
            "2026-11-01T25:00",
            "-1",
            "1e9",
        ),
    ),
    ("runs --until @", (*TEXTS, "2026-13-01", "0001-01-01", "9999-12-31T23:59:59")),
    ("runs --kind @", TEXTS),
    ("runs --source @", TEXTS),
    ("runs --last @", NUMBERS),
    ("runs --operator @", TEXTS),
    ("export csv @ --out out", PATHS),
    ("export csv run --out @", OUTPUTS),
    ("export mcap @ --out out.mcap", PATHS),
    ("export mcap run --out @", OUTPUTS),
    ("export mjcf --out @", OUTPUTS),
    ("export fmu --rig @ --out out.fmu", PATHS),
    ("export fmu --model @ --out out.fmu", PATHS),
    ("export fmu --input @ --out out.fmu", TEXTS),
    ("export fmu --platform @ --out out.fmu", TEXTS),
    ("sweep @ --dry-run", PATHS),
    (
        "sweep --vary @ --outputs energy_J --dry-run",
        (
            *TEXTS,
            "height_mm=",
            "height_mm=nan",
            "height_mm=1:2",
            "height_mm=1:2:0",
            "height_mm=1:2:1e9",
            "height_mm=2:1:5",
            "height_mm=1:2:-3",
            "height_mm=inf:nan:3",
            "height_mm=1e300",
            "x=1",
            "k0=0",
            "k0=-1:1:3",
            "height_mm=1:2:999999999999",
            "strip.material=x",
        ),
    ),
    ("sweep --vary height_mm=215,235 --outputs @ --dry-run", TEXTS),
    (
        "sweep --vary height_mm=215,235 --outputs energy_J --set @ --dry-run",
        (*TEXTS, "k0=nan", "k0=", "speed_rad_s=0", "speed_rad_s=1e300", "height_mm=1"),
    ),
    ("sweep --vary height_mm=215..235 --outputs energy_J --samples @ --dry-run", NUMBERS),
    ("sweep --vary height_mm=215:235:2 --outputs energy_J --method @ --samples 4 --dry-run", TEXTS),
    ("static load --down @", NUMBERS),
    ("static load --along @", NUMBERS),
    ("static load --shaft @", NUMBERS),
    ("static load --picture @", OUTPUTS),
    ("static load --rig @", PATHS),
    (
        "static force --angles @",
        (
            *TEXTS,
            "1,2",
            "nan,0,0,0,0,0,0",
            "1e300,0,0,0,0,0,0",
            "0,360,360,360,360,360,360",
            "1,2,3,4,5,6,7,8",
            "1;2;3",
        ),
    ),
    ("static force @", PATHS),
    ("static report @", PATHS),
    ("static report run --hinge-std-deg @", NUMBERS),
    ("static photos run @ --camera cam.toml", PATHS),
    ("static photos @ folder --camera cam.toml", PATHS),
    ("calibrate camera @", PATHS),
    (
        "calibrate camera --board @ --make-board b.png",
        (
            *TEXTS,
            "10x7,25",
            "10x7,25,30",
            "0x0,1,1",
            "1e9x1e9,1,1",
            "99999x99999,1,0.5",
            "10x7,nan,18",
            "-3x4,25,18",
            "10x7,1e300,18,4x4",
        ),
    ),
    ("calibrate camera --make-board @", (*OUTPUTS, "x.tiff", "board")),
    ("calibrate camera folder --plane @", PATHS),
    ("crosscheck --protocol @", PATHS),
    ("contract @", PATHS),
    ("doctor --rig @", PATHS),
    ("doctor --runs @", OUTPUTS),
    ("setup motor --rig @", PATHS),
    ("setup motor --rig twin --endpoints @", PATHS),
    ("init --mjcf @ --data folder", PATHS),
    ("init --mjcf ./empty.toml --data @", PATHS),
    ("prove --so-far --out @", OUTPUTS),
    ("prove --so-far --out new --kind @", TEXTS),
    ("prove --so-far --out new --cases @", NUMBERS),
    ("trip @", TEXTS),
    ("twin serve --seconds 0.01 --rig @", PATHS),
    (
        "twin serve --seconds 0.01 --listen @",
        (*TEXTS, "::1", "0.0.0.0.0", "256.1.1.1", "localhost", "1.2.3.4", "127.0.0.1:80"),
    ),
    ("twin serve --seconds 0.01 --can-port @", ("-1", "65536", "nan", "text", "1e3", "", "80.5")),
    (
        "twin serve --seconds 0.01 --height @",
        ("nan", "inf", "0", "-1", "1000", "text", "1e300", ""),
    ),
    ("twin serve --seconds @ --fault x", NUMBERS),
    ("twin tell @ --control-port 1", TEXTS),
    ("twin tell faults --control-port @", ("0", "-1", "65536", "nan", "text", "", "1")),
    ("@", (*TEXTS, "dinamic", "plans", "--verion", "-x")),
    ("dynamic @", TEXTS),
)


class Recordings:
    """A recording for the commands that read one, made once."""

    def __init__(self, folder: Path) -> None:
        self.campaign = ROOT / "tests" / "data" / "small-campaign"
        self.run = folder / RUN
        _typed(("import", str(self.campaign), "--out", str(self.run)))
        # The first simulation may have to compile the model, which no case is to pay for.
        _typed(("predict", *HEIGHT_SPEED))


def _furnish(folder: Path, recordings: Recordings) -> None:
    """The names that PATHS and OUTPUTS contain."""
    for name in ("folder", "folder.toml"):
        (folder / name).mkdir()
    for name in ("pipe", "pipe.toml"):
        os.mkfifo(folder / name)
    for name in ("loop", "loop.toml"):
        (folder / name).symlink_to(name)
    (folder / "dangling").symlink_to("nowhere/deeper")
    for name in ("empty", "empty.toml", "empty.csv", "file"):
        (folder / name).write_bytes(b"")
    (folder / "noise.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + random.Random(1).randbytes(3000))
    shutil.copy(ROOT / "calibration" / "twin-camera.toml", folder / "cam.toml")
    shutil.copytree(recordings.campaign, folder / "campaign")
    shutil.copytree(recordings.run, folder / "run")


def _argument_case(chance: random.Random, recordings: Recordings) -> Case:
    command, values = chance.choice(ARGUMENTS)
    value = chance.choice(values)
    words = tuple(word.replace("@", value) for word in command.split())
    return Case(
        f"{command}: {value[:40]!r}",
        words,
        lambda folder: _furnish(folder, recordings),
        (1,) if values is OUTPUTS or "tell" in words else (),
    )


def make_cases(seed: int, count: int, recordings: Recordings) -> Iterator[Case]:
    """Cases by their seed: three of files to two of arguments."""
    chance = random.Random(seed)
    for _ in range(count):
        yield _file_case(chance) if chance.random() < 0.6 else _argument_case(chance, recordings)


# -- what is owed
# --------------------------------------------------------------------------------------------------


SIGNS = {stat.S_IFREG: "", stat.S_IFDIR: "/", stat.S_IFLNK: "@", stat.S_IFIFO: "|"}


class TookTooLongError(BaseException):
    """No exception of the command: nothing may catch it."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code, both streams, warnings of Python, seconds."""

    code: int | None
    out: str
    err: str
    warned: tuple[str, ...]
    took_s: float


class _Kept(io.BytesIO):
    """Can still be read when the command has closed it, as it does with a stream that fails."""

    def close(self) -> None:
        """Does nothing."""


def _typed(words: Words) -> Ended:
    """Type a command in this process, under limits of time and memory."""

    def ring(_number: int, _frame: object) -> None:
        raise TookTooLongError

    kept = _Kept(), _Kept()
    out, err = (io.TextIOWrapper(one, encoding="utf-8", write_through=True) for one in kept)
    bells = (signal.SIGALRM, signal.SIGPROF)
    before = (
        sys.argv,
        resource.getrlimit(resource.RLIMIT_AS),
        [signal.signal(bell, ring) for bell in bells],
    )
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    sys.argv = ["rfca-rig", *words]
    code: int | None = None
    began_s = time.monotonic()
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_CPU_S)
    resource.setrlimit(
        resource.RLIMIT_AS, (pages * resource.getpagesize() + HEADROOM_BYTES, before[1][1])
    )
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            warnings.catch_warnings(record=True) as warned,
        ):
            warnings.simplefilter("default")
            run()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else 0
    except TookTooLongError:
        code = None
    finally:
        for timer in (signal.ITIMER_REAL, signal.ITIMER_PROF):
            signal.setitimer(timer, 0)
        resource.setrlimit(resource.RLIMIT_AS, before[1])
        for bell, handler in zip(bells, before[2], strict=True):
            signal.signal(bell, handler)
        sys.argv = before[0]
    texts = [one.getvalue().decode("utf-8", "replace") for one in kept]
    shown = tuple(
        str(one.message)
        for one in warned
        if issubclass(one.category, RuntimeWarning | UserWarning | SyntaxWarning)
    )
    return Ended(code, *texts, shown, time.monotonic() - began_s)


def find_violations(case: Case, folder: Path) -> list[str]:
    """What the case's command owes and does not give; `folder` is new, and the current folder
    for as long as the command lasts.
    """
    case.prepare(folder)
    before = _listing(folder)
    return list(_judge(case, _typed_in(folder, case.words), before, _listing(folder)))


def show(case: Case, folder: Path) -> Ended:
    """How the case's command ends, to look at."""
    case.prepare(folder)
    return _typed_in(folder, case.words)


def _typed_in(folder: Path, words: Words) -> Ended:
    home = Path.cwd()
    os.chdir(folder)
    try:
        return _typed(words)
    finally:
        os.chdir(home)


def _judge(case: Case, ended: Ended, before: set[str], after: set[str]) -> Iterator[str]:
    if ended.code is None:
        yield f"took longer than {LONGEST_S} s, or {LONGEST_CPU_S} s of a processor"
        return
    yield from _judge_output(ended)
    yield from _judge_files(before, after)
    if ended.code != 0:
        yield from _judge_failure(case, ended, after - before)


def _judge_output(ended: Ended) -> Iterator[str]:
    """What no command may print, however it ends."""
    if "mistake in rfca-rig" in ended.err or "Traceback" in ended.err:
        yield f"a mistake: {_last_line(ended)[:300]}"
    if any(
        unicodedata.category(letter) == "Cc" and letter not in "\n\t"
        for letter in ended.out + ended.err
    ):
        yield "control characters reach the terminal"
    if ended.warned:
        yield f"Python warns: {ended.warned[0][:200]}"


def _judge_files(before: set[str], after: set[str]) -> Iterator[str]:
    """What no command may do to the files, however it ends."""
    lost = {name for name in before - after if name.endswith(("|", "@"))}
    if lost:
        yield f"replaced {sorted(lost)[:3]}"
    if any(name.endswith(".writing") or ".writing-" in name for name in after):
        yield f"something half written: {sorted(after - before)[:3]}"


def _judge_failure(case: Case, ended: Ended, written: set[str]) -> Iterator[str]:
    """What a command that fails may not do: end with another exit code, write a file and refuse
    then, or say more or less than one line.
    """
    last = _last_line(ended)
    if ended.code != 2 and ended.code not in case.failures and "mistake" not in last:
        yield f"exit code {ended.code}: {last[:300]}"
    if written and ended.code == 2:
        yield f"wrote {sorted(written)[:3]} and refused: {last[:200]}"
    own = [
        line
        for line in ended.err.splitlines()
        if not line.startswith(("SIM ", "REAL ", "IMPORT ", "  "))
    ]
    # A red finding on standard output is a result of the doctor.
    is_finding = (ended.code == 2 and "check" in case.words) or (
        ended.code == 1 and "doctor" in case.words and " red" in ended.out
    )
    if is_finding and not own:
        return
    if len(own) != 1 or not own[0].startswith("rfca-rig: "):
        yield f"{len(own)} lines: {' | '.join(own)[:300]}"
    elif len(own[0]) > LONGEST_LINE:
        yield f"a line of {len(own[0])} characters: {own[0][:100]}"


def _last_line(ended: Ended) -> str:
    """The last line on standard error."""
    return ended.err.strip().rpartition("\n")[2]


def _listing(folder: Path) -> set[str]:
    """Names with the kind of what stands there, so that a pipe that became a file is seen."""
    found = [
        Path(above, name)
        for above, folders, files in os.walk(folder)
        for name in (*folders, *files)
    ]
    return {
        f"{path.relative_to(folder)}{SIGNS.get(stat.S_IFMT(path.lstat().st_mode), '?')}"
        for path in found
    }

"""rfca-rig init: writes the first draft of a rig file, of campaign.toml or of experiment.toml."""

import re
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import AllowOutside
from rfca_rig.cli.paths import check_writable, find_shipped, write_twin_rig
from rfca_rig.cli.terminal import echo, has_terminal
from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    from rfca_rig.description.rig_draft import RigAnswers
    from rfca_rig.devices import SensorMake
    from rfca_rig.devices.checks import FoundSensor


QUESTIONS = 10
# Height over leg length of a stroke that presses the twin's leg well, and its speed: the first row
# of Table II.
FIRST_HEIGHT_SHARE = 215.0 / 290.0
FIRST_SPEED_RAD_S = 2.433

RigFileToWrite = Annotated[
    Path | None, typer.Option("--rig", metavar="FILE", help="The rig file to write.")
]
TakeAll = Annotated[
    bool, typer.Option("--yes", help="Of a rig file: ask nothing, take every suggested answer.")
]
Model = Annotated[
    Path | None,
    typer.Option("--mjcf", "--urdf", metavar="FILE", help="The mechanism's model, MJCF or URDF."),
]
Data = Annotated[
    Path | None,
    typer.Option(
        "--data",
        metavar="DIR",
        help="A folder with recordings: tables, HDF5, files of data loggers, CAN logs or bags.",
    ),
]


def init(
    rig: RigFileToWrite = None,
    yes: TakeAll = False,
    mjcf: Model = None,
    data: Data = None,
    allow_outside: AllowOutside = False,
) -> None:
    """Write a rig file after ten questions, a draft of campaign.toml for a leg's recordings from
    elsewhere, or of experiment.toml for those of any mechanism.

    Enter takes the suggested answer. Devices that are found on this computer are suggested; nothing
    that could move is touched. From a pipe or a file: one answer per line, an empty line takes the
    suggested one. For recordings of a leg give their folder: --data recordings. Columns, units,
    signs, heights and speeds are guessed, each with its reason; what cannot be guessed is a
    question mark. For a mechanism give its model, too: --mjcf arm.xml --data recordings.

    Example: rfca-rig init --rig our-rig.toml
    """
    if rig is not None and mjcf is None and data is None:
        _write_rig_file(rig, yes)
    elif rig is None and mjcf is not None and data is not None:
        from rfca_rig.campaign.experiment import PLACEHOLDER, write_draft
        from rfca_rig.mechanism.load import load_mechanism

        path = write_draft(load_mechanism(mjcf, (data,), allow_outside), data, allow_outside)
        open_questions = path.read_text(encoding="utf-8").count(f"= {PLACEHOLDER}")
        echo(f"{path}: {open_questions} values to fill in, each marked with a question mark")
        echo(f"then: rfca-rig check {data}", err=True)
    elif rig is None and data is not None:
        _write_campaign_file(data, allow_outside)
    else:
        raise BadInput(
            "init: give --rig FILE for a rig file, --data DIR for recordings of a leg, or "
            "--mjcf FILE and --data DIR for those of a mechanism"
        )


def _write_campaign_file(folder: Path, allow_outside: bool) -> None:
    from rfca_rig.campaign.leg_draft import write_leg_draft
    from rfca_rig.toml import read_data

    usual = read_data(find_shipped("calibration") / "twin.toml")
    draft = write_leg_draft(folder, usual, allow_outside)
    echo(
        f"{draft.path}: {draft.open_values} values to fill in, each marked with a question mark; "
        f"{draft.guesses} guesses and {draft.usual_values} usual values to check"
    )
    echo(f"then: rfca-rig check {folder}", err=True)


def _write_rig_file(path: Path, takes_all: bool) -> None:
    from rfca_rig.description.rig_draft import USUAL, draft_rig
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.recording.atomic import write_atomically
    from rfca_rig.toml import model_of, read_data

    check_writable(path)
    shipped = find_shipped("calibration")
    usual = read_data(shipped / "twin.toml")
    answers = _ask(usual, path.parent, takes_all)
    text = draft_rig(path.stem, answers, usual)
    # Nothing is written that the other commands would refuse.
    drafted = model_of(text, RigFile, path)
    if drafted.camera is None:
        write_atomically(path, text.encode("utf-8"))
    else:
        write_twin_rig(path, text)
    height_mm = round(FIRST_HEIGHT_SHARE * sum(answers.link_lengths_mm))
    marked = sum(line.rstrip().endswith(USUAL) for line in text.splitlines())
    echo(f"{path}: a twin of your rig; {marked} lines hold a usual value, to check against yours")
    echo(
        (
            f"then: rfca-rig dynamic run --rig {path} --height {height_mm} --speed "
            f"{FIRST_SPEED_RAD_S} --repeats 1"
        ),
        err=True,
    )


@dataclass(frozen=True)
class _Found:
    """Devices of this computer: buses as (interface, channel), serial ports, files beside the rig
    file, and sensors that answered.

    By kind of force sensor: the makes that may be asked for, files, and what answered.
    """

    buses: Sequence[tuple[str, str]]
    ports: Sequence[str]
    makes: "dict[str, SensorMake]"
    files: dict[str, list[str]]
    sensors: "dict[str, FoundSensor]"

    def list_addresses(self, kind: str, key: str) -> list[str]:
        """Where a sensor of that kind can be, most probable first; `key` is that of its address."""
        addresses = []
        if kind in self.sensors:
            addresses.append(self.sensors[kind].address)
        addresses += self.files[kind]
        if key == "port":
            addresses += self.ports
        return addresses

    def describe(self) -> str:
        """All of it in one line."""
        files = [name for names in self.files.values() for name in names]
        return ", ".join(
            (
                *(" ".join(bus) for bus in self.buses),
                *self.ports,
                *files,
                *(sensor.name for sensor in self.sensors.values()),
            )
        )


def _find_devices(folder: Path) -> _Found:
    from rfca_rig.devices import OWN, find_sensor, list_sensors, load_object
    from rfca_rig.devices.checks import look_for_serial_ports
    from rfca_rig.doctor.ports import can_interfaces, look_for_adapters
    from rfca_rig.doctor.rig_checks import find_sensors

    sensors = {kind: sensor for kind, sensor in find_sensors().items() if sensor.name}
    buses = [*(("socketcan", name) for name in can_interfaces()), *look_for_adapters()]
    ports = [port.path for port in look_for_serial_ports()]
    makes: dict[str, SensorMake] = {}
    files: dict[str, list[str]] = {}
    for kind in list_sensors():
        if kind == OWN:
            continue
        # A package may offer a motor, or may not be usable.
        with suppress(BadInput):
            makes[kind] = find_sensor(kind)
    for kind, make in makes.items():
        key, _, usual = make.address
        is_file = key in load_object(make.section).file_keys
        if is_file:
            files[kind] = sorted(file.name for file in folder.glob(f"*{Path(usual).suffix}"))
        else:
            files[kind] = []
    return _Found(buses, ports, makes, files, sensors)


def _ask(usual: dict[str, Any], folder: Path, takes_all: bool) -> "RigAnswers":
    """Asks the ten questions; each has a suggestion."""
    from rfca_rig.description.rig_draft import RigAnswers
    from rfca_rig.devices import OWN, find_motor, list_motors

    devices = _find_devices(folder)
    makes = devices.makes
    echo(
        f"found on this computer: {devices.describe() or 'no bus, serial port or force sensor'}",
        err=True,
    )
    asked = iter(range(1, QUESTIONS + 1))
    can_answer = has_terminal()

    def ask(question: str, suggestion: str, read: Callable[[str], Any]) -> Any:
        number = next(asked)
        if takes_all:
            return read(suggestion)
        if can_answer:
            return typer.prompt(
                f"{number}/{QUESTIONS} {question}", default=suggestion, value_proc=read
            )
        return _read_line(number, question, suggestion, read)

    leg = usual["leg"]
    lengths_mm = ask(
        "lengths of the links from the shaft outwards, mm",
        _join(leg["link_lengths_mm"]),
        _read_numbers(),
    )
    # Links of the same profile weigh in proportion to their length.
    g_per_mm = sum(leg["link_masses_g"]) / sum(leg["link_lengths_mm"])
    masses_g = ask(
        "their masses, g",
        _join(round(g_per_mm * length, 3) for length in lengths_mm),
        _read_numbers(len(lengths_mm)),
    )
    below_mm = ask(
        "from the shaft's axis down to the sensor's origin, mm",
        f"{usual['sensor']['below_shaft_mm']:g}",
        _read_number(is_positive=False),
    )
    force_N = ask(
        "largest force that leg and sensor bear, N",
        f"{usual['limits']['force_N']:g}",
        _read_number(),
    )
    torque_Nm = ask(
        "largest moment on the sensor, N m", f"{usual['limits']['torque_Nm']:g}", _read_number()
    )
    others = "other makes: docs/add-a-motor.md"
    drives = [kind for kind in list_motors() if kind != OWN]
    drive = ask(
        f"drive: {', '.join(drives)} ({others})", usual["motor"]["device"], _read_word(drives)
    )
    buses = [" ".join(bus) for bus in devices.buses] or ["socketcan can0"]
    interface, channel = ask("its bus: interface and channel of python-can", buses[0], _read_bus)
    number = ask("its number on that bus", str(find_motor(drive).number[1]), _read_count)
    # A sensor that answered is certain; a calibration file beside the rig file speaks for its
    # sensor.
    probable = [
        *devices.sensors,
        *(kind for kind, names in devices.files.items() if names),
        *makes,
    ][0]
    sensor = ask(f"force sensor: {', '.join(makes)}", probable, _read_word([*makes]))
    key, question, usual_address = makes[sensor].address
    address = ask(question, [*devices.list_addresses(sensor, key), usual_address][0], str.strip)
    if sensor in devices.sensors:
        counts = devices.sensors[sensor].counts
    else:
        counts = None
    return RigAnswers(
        lengths_mm,
        masses_g,
        below_mm,
        force_N,
        torque_Nm,
        drive,
        interface,
        channel,
        number,
        sensor,
        address,
        counts,
    )


def _read_line(number: int, question: str, suggestion: str, read: Callable[[str], Any]) -> Any:
    """The answer in the next line of a pipe or file. Raises BadInput where there is none or it
    cannot be: it cannot be asked for again.
    """
    line = ""
    try:
        if sys.stdin is not None:
            line = sys.stdin.readline()
    except UnicodeDecodeError:
        raise BadInput(
            f"init: line {number} of the answers is not UTF-8 text; save them as UTF-8"
        ) from None
    if not line:
        raise BadInput(
            f"init: standard input holds {number - 1} of {QUESTIONS} answers; none for "
            f"question {number}, {question}; give one answer per "
            "line (an empty line takes the suggestion), answer on a terminal, or take "
            "all suggestions by --yes"
        )
    try:
        return read(line.strip() or suggestion)
    except typer.BadParameter as error:
        raise BadInput(
            f"init: answer {number} of {QUESTIONS}, {question}: {line.strip()!r}; {error.message}"
        ) from None


def _join(values: Any) -> str:
    return " ".join(f"{value:g}" for value in values)


def _read_number(is_positive: bool = True) -> Callable[[str], float]:
    def read(text: str) -> float:
        (value,) = _read_numbers(1, is_positive)(text)
        return value

    return read


def _read_numbers(
    count: int | None = None, is_positive: bool = True
) -> Callable[[str], tuple[float, ...]]:
    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in re.split(r"[\s,;]+", text.strip()))
        except ValueError:
            raise typer.BadParameter(
                "give numbers, separated by blanks, with a point for decimals"
            ) from None
        limits = "below 1e6"
        is_within = all(abs(value) < 1e6 for value in values)
        if is_positive:
            limits = "above 0 and below 1e6"
            is_within = is_within and all(value > 0.0 for value in values)
        if not is_within:
            raise typer.BadParameter(f"give numbers {limits}")
        if count is not None and len(values) != count:
            raise typer.BadParameter(
                f"give {count} {'number' if count == 1 else 'numbers'}, not {len(values)}"
            )
        return values

    return read


def _read_word(words: Sequence[str]) -> Callable[[str], str]:
    def read(text: str) -> str:
        if text.strip() not in words:
            raise typer.BadParameter(f"give one of {', '.join(words)}")
        return text.strip()

    return read


def _read_bus(text: str) -> tuple[str, str]:
    interface, _, channel = text.strip().partition(" ")
    if not channel.strip():
        raise typer.BadParameter("give two words, as socketcan can0")
    return interface, channel.strip()


def _read_count(text: str) -> int:
    if not text.strip().isdecimal() or int(text) > 127:
        raise typer.BadParameter("give a whole number from 0 to 127")
    return int(text)

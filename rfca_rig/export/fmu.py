"""Export of a leg as an FMU: a model for co-simulation of the standard FMI 3.0, which Simulink,
Dymola, OpenModelica and RecurDyn load, without Python.

The same compiled functions that simulate a stroke here are compiled ahead of time and linked with a
program in C, `fmu_interface.c`, that has the functions of the standard.
"""

import hashlib
import io
import platform as this_platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import rfca_rig
from rfca_rig.description.rig_file import RigFile
from rfca_rig.errors import BadInput, RigError
from rfca_rig.export.fmu_code import TRIPLES, MemoryLayout, compile_leg
from rfca_rig.export.fmu_description import (
    MODEL_IDENTIFIER,
    SPEED_INPUT,
    TORQUE_INPUT,
    LegInterface,
    LegProgram,
    OpenParameter,
    list_outputs,
    write_description,
    write_documentation,
    write_header,
)
from rfca_rig.export.fmu_leg import (
    ShaftInput,
    check_effects,
    find_parameters,
    lay_out_leg,
    set_up_leg,
)
from rfca_rig.model.kernel.compiled import CACHE_FOLDER
from rfca_rig.model.kernel.integrator import integrate
from rfca_rig.model.kernel.laws import LawUse
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.subprocesses import python_command

PACKAGE = Path(rfca_rig.__file__).parent
SOURCES = Path(__file__).parent
COMPILER_OPTIONS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")
# The oldest Linux that the binary has to run on: glibc 2.17 is of 2012.
ZIG_TARGETS = {"x86_64-linux": "x86_64-linux-gnu.2.17", "x86_64-windows": "x86_64-windows-gnu"}
ENDINGS = {"x86_64-linux": ".so", "x86_64-windows": ".dll"}
# The earliest time that a zip file can hold: the same leg gives the same file.
NO_TIME = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class LegModel:
    """What is exported: the model of a rig under a title, the kind and path of the file that it
    comes from, and in words what of this file is not part of the model.
    """

    rig: RigModel
    title: str
    kind: str
    file: Path
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExportedFmu:
    """The platforms of the binaries, and the names of the variables."""

    platforms: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]


def list_left_out(file: RigFile) -> tuple[str, ...]:
    """What a rig file states beside its model, and an FMU does not have."""
    items = ["ramp_s of [drive]: the input is the motion"]
    if file.sensor.noise_std is not None:
        items.append("noise_std of [sensor]: the forces are exact")
    if file.twin is not None:
        items.append("[twin]: noise, scatter and drive of the simulated rig")
    return tuple(items)


def export_fmu(
    model: LegModel,
    out: Path,
    height_m: float,
    shaft_input: ShaftInput,
    platforms: Sequence[str] = (),
) -> ExportedFmu:
    """Writes the FMU `out`, completely or not at all.

    Parameters
    ----------
    model
        The leg with its ground, mount, drive and effects.
    out
        The file.
    height_m
        Start value of the height of the shaft above the ground.
    shaft_input
        What the input is: a commanded speed, or the torque of the drive.
    platforms
        Those of `fmu_code.TRIPLES` to make binaries for; () for this computer's.

    Raises
    ------
    BadInput
        For an effect that an FMU cannot have, a platform without a compiler, or where numba is
        switched off.
    RigError
        When the disk refuses, or the compiler fails.
    """
    own = _own_platform()
    platforms = tuple(dict.fromkeys(platforms)) or (own,)
    # Before the compilation of half a minute.
    commands = [_find_compiler(platform) for platform in platforms]
    if not hasattr(integrate, "py_func"):
        raise BadInput("numba is switched off (NUMBA_DISABLE_JIT); an FMU is compiled code")
    check_effects(model.rig, height_m, shaft_input)
    setup = set_up_leg(model.rig, height_m)
    layout = lay_out_leg(setup, shaft_input)
    laws = setup.list_laws(setup.chain())
    # The stated height: an effect may have changed that of the setup.
    parameters = find_parameters(model.rig, height_m, layout, shaft_input)
    interface = _describe(model, layout, laws, parameters, shaft_input)
    drive = setup.drive
    program = LegProgram(
        layout,
        laws,
        drive_sags=drive is not None and not drive.holds_start,
        drive_holds=drive is not None and drive.holds_start,
        below_shaft_m=model.rig.sensor.below_shaft_m,
        start_angle_rad=model.rig.leg.start_angle_rad,
    )
    header = write_header(interface, program)
    files = {
        "modelDescription.xml": write_description(interface).encode(),
        "documentation/index.html": write_documentation(interface).encode(),
        "documentation/licenses/license.txt": _read_licence(),
    }
    objects = compile_leg(layout, laws, platforms)
    for platform, command, code in zip(platforms, commands, objects, strict=True):
        name = f"binaries/{platform}/{MODEL_IDENTIFIER}{ENDINGS[platform]}"
        files[name] = _build_binary(command, header, code)
    write_atomically(out, _zip(files))
    return ExportedFmu(
        platforms,
        (interface.input.name,),
        tuple(output.name for output in interface.outputs),
        tuple(parameter.variable.name for parameter in interface.parameters),
    )


def _own_platform() -> str:
    systems = {"linux": "linux", "win32": "windows"}
    machine = {"x86_64": "x86_64", "AMD64": "x86_64"}.get(this_platform.machine())
    own = f"{machine}-{systems.get(sys.platform)}"
    if own not in TRIPLES:
        raise BadInput(
            f"this computer is none of {', '.join(TRIPLES)}, for which an FMU can be made; export "
            "it on one of these"
        )
    return own


def _find_compiler(platform: str) -> list[str]:
    """The command of a compiler of C for this platform."""
    if platform not in TRIPLES:
        raise BadInput(f"--platform {platform}: is none of {', '.join(TRIPLES)}")
    # Preferred, because its binaries run on older systems than this one.
    if find_spec("ziglang") is not None:
        return python_command("-m", "ziglang", "cc", "-target", ZIG_TARGETS[platform])
    own = shutil.which("cc") if platform == _own_platform() else None
    if own is None:
        raise BadInput(
            f"no C compiler for {platform}: there is none of the system, and the extra fmu, which "
            'brings one, is not installed; type pip install "rfca-rig[fmu]"'
        )
    return [own]


def _describe(
    model: LegModel,
    layout: MemoryLayout,
    laws: Sequence[LawUse],
    parameters: tuple[OpenParameter, ...],
    shaft_input: ShaftInput,
) -> LegInterface:
    content = hashlib.sha256(layout.numbers.tobytes())
    names = [(use.law.__module__, use.law.__qualname__, use.place, use.only) for use in laws]
    for part in (names, parameters, shaft_input, rfca_rig.__version__, Path(CACHE_FOLDER).name):
        content.update(repr(part).encode())
    return LegInterface(
        title=model.title,
        source={
            model.kind: model.file.name,
            "SHA-256": hashlib.sha256(model.file.read_bytes()).hexdigest(),
        },
        input=SPEED_INPUT if shaft_input == "speed" else TORQUE_INPUT,
        outputs=list_outputs(len(model.rig.leg.link_lengths_m)),
        parameters=parameters,
        notes=_write_notes(model, shaft_input),
        token=f"{{{content.hexdigest()[:32]}}}",
    )


def _write_notes(model: LegModel, shaft_input: ShaftInput) -> tuple[str, ...]:
    """What a user of the model has to know."""
    rig = model.rig
    links = len(rig.leg.link_lengths_m)
    notes = [
        f"A planar chain of {links} rigid links with elastic hinges; the end of each link may "
        "touch a compliant ground with friction. Nothing moves out of the plane.",
        "Axes: y along the ground, z up, angles from the horizontal, positive downwards. Forces "
        "are those that the leg exerts on its mount, as a sensor with its z axis down reads them.",
        "It begins at rest under its weight. The rest pose is computed from the parameters when "
        "the initialization ends; parameters are fixed from then on.",
        "Steps inside of a communication step follow the tolerance of the simulation: the error "
        "per step in angles [rad], 1e-5 if none is given, and 3000 times as much in rad/s.",
        "Forces are exact: they have no noise, lag or rounding of a sensor.",
    ]
    notes += [f"Not part of the model: {words}." for words in model.left_out]
    if shaft_input == "speed":
        notes.append(
            "The speed of the command changes linearly during a communication step and reaches "
            "the input at its end: a command acts one communication step late, and a jump of the "
            "input is a ramp of one communication step."
        )
    else:
        notes.append(
            "The shaft is held at its start angle until the first step; then it turns under the "
            "torque of the input, which stays constant during a communication step."
        )
    if rig.effects:
        notes.append(
            "Effects, whose values cannot be changed: "
            + "; ".join(_describe_effect(present) for present in rig.effects)
            + "."
        )
    return tuple(notes)


def _describe_effect(present: PresentEffect) -> str:
    values = ", ".join(f"{name} {value:g}" for name, value in present.values)
    return f"{present.id} ({values})" if values else present.id


def _read_licence() -> bytes:
    """The licence of this package, which is that of the compiled code."""
    # In an installed package, beside a folder of packages there may be another one's licence.
    for path in (PACKAGE / "shipped" / "LICENSE", PACKAGE.parent / "LICENSE"):
        if path.is_file():
            return path.read_bytes()
    raise RigError(f"{PACKAGE / 'shipped' / 'LICENSE'}: is missing; install rfca-rig again")


def _build_binary(command: Sequence[str], header: str, code: bytes) -> bytes:
    """The shared library of the compiled leg and the program in C."""
    with tempfile.TemporaryDirectory(prefix="rfca-rig-fmu-") as folder:
        place = Path(folder)
        (place / "leg.h").write_text(header, encoding="ascii")
        (place / "leg.o").write_bytes(code)
        library = place / MODEL_IDENTIFIER
        arguments = [
            *COMPILER_OPTIONS,
            f"-I{place}",
            f"-I{SOURCES}",
            str(SOURCES / "fmu_interface.c"),
            str(place / "leg.o"),
            "-lm",
            "-o",
            str(library),
        ]
        result = subprocess.run(
            [*command, *arguments], cwd=place, capture_output=True, text=True, check=False
        )
        if result.returncode != 0:
            first = next(iter(result.stderr.strip().splitlines()), "no message")
            raise RigError(f"the C compiler {command[0]} failed: {first}")
        return library.read_bytes()


def _zip(files: Mapping[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, NO_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data)
    return content.getvalue()

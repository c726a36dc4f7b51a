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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import rfca_rig
from rfca_rig.errors import BadInput, RigError
from rfca_rig.export.fmu_code import (
    TRIPLES,
    LegMemory,
    MemoryLayout,
    Stepping,
    compile_leg,
    lay_out,
)
from rfca_rig.export.fmu_description import (
    MODEL_IDENTIFIER,
    SPEED_INPUT,
    START_ANGLE,
    TORQUE_INPUT,
    LegInterface,
    LegProgram,
    OpenParameter,
    Use,
    Variable,
    list_outputs,
    write_description,
    write_documentation,
    write_header,
)
from rfca_rig.model.catalogue import resolve_effect, set_up
from rfca_rig.model.chain import (
    Tolerance,
    allocate_samples,
    allocate_workspace_of,
    make_unloaded_state,
)
from rfca_rig.model.kernel.compiled import CACHE_FOLDER
from rfca_rig.model.kernel.integrator import integrate
from rfca_rig.model.kernel.state import Shaft
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import Setup, add_drive
from rfca_rig.recording.atomic import write_atomically

Floats = NDArray[np.float64]
Input = Literal["speed", "torque"]

PACKAGE = Path(rfca_rig.__file__).parent
SOURCES = Path(__file__).parent
# Of the program in C: warnings are errors, because nobody would see them.
COMPILER_OPTIONS = (
    "-std=c99 -O2 -Wall -Wextra -Werror -fPIC -shared -fvisibility=hidden -s".split()
)
# The oldest Linux that the binary has to run on: glibc 2.17 is of 2012.
ZIG_TARGETS = {"x86_64-linux": "x86_64-linux-gnu.2.17", "x86_64-windows": "x86_64-windows-gnu"}
ENDINGS = {"x86_64-linux": ".so", "x86_64-windows": ".dll"}
# The earliest time that a zip file can hold: the same leg gives the same file.
NO_TIME = (1980, 1, 1, 0, 0, 0)

# A parameter's effect on the numbers of the leg is found by varying it by this share.
VARIATION = 0.1
# Numbers that follow from a parameter agree with a straight line to rounding.
STRAIGHT = 1e-12


@dataclass(frozen=True)
class LegModel:
    """What is exported: the model of a rig under a title, with where it comes from, name and value.
    """

    rig: RigModel
    title: str
    source: Mapping[str, str]


@dataclass(frozen=True)
class ExportedFmu:
    """The platforms of the binaries, and the names of the parameters that are open."""

    platforms: tuple[str, ...]
    parameters: tuple[str, ...]


def export_fmu(
    model: LegModel, out: Path, height_m: float, shaft_input: Input, platforms: Sequence[str] = ()
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
    platforms = tuple(dict.fromkeys(platforms)) or (_own_platform(),)
    # Before the compilation of half a minute.
    commands = [_find_compiler(platform) for platform in platforms]
    if not hasattr(integrate, "py_func"):
        raise BadInput("numba is switched off (NUMBA_DISABLE_JIT); an FMU is compiled code")
    _check_effects(model.rig, height_m, shaft_input)
    setup = _set_up(model.rig, height_m)
    layout = _lay_out(setup, shaft_input)
    interface = _describe(model, setup, layout, shaft_input)
    laws = setup.list_laws(setup.chain())
    drive = setup.drive
    program = LegProgram(
        layout,
        laws,
        drive_sags=drive is not None and not drive.holds_start,
        drive_holds=drive is not None and drive.holds_start,
        below_shaft_m=model.rig.sensor.below_shaft_m,
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
        platforms, tuple(parameter.variable.name for parameter in interface.parameters)
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
        # Not -P, but -I, is refused by no version; both keep the current folder off the path.
        return [sys.executable, "-P", "-m", "ziglang", "cc", "-target", ZIG_TARGETS[platform]]
    own = shutil.which("cc") if platform == _own_platform() else None
    if own is None:
        raise BadInput(
            f"no C compiler for {platform}: there is none of the system, and the extra fmu, which "
            'brings one, is not installed; type pip install "rfca-rig[fmu]"'
        )
    return [own]


# The motion is the input of an FMU: effects see a shaft that stands.
def _stand(rig: RigModel) -> ShaftMotion:
    return ramp_to_speed(rig.leg.start_angle_rad, 0.0, 1.0, 1.0)


def _set_up(rig: RigModel, height_m: float) -> Setup:
    return set_up(rig, height_m, _stand(rig))


def _check_effects(rig: RigModel, height_m: float, shaft_input: Input) -> None:
    """Raises BadInput for the first effect that an FMU cannot have."""
    if rig.swing is not None:
        raise BadInput("the model swings before the stroke; an FMU begins at rest")
    for present in rig.effects:
        if reason := _why_not(rig, present, height_m, shaft_input):
            raise BadInput(
                f"effect {present.id}: {reason}; leave the effect out of the rig file or model file"
            )


def _why_not(
    rig: RigModel, present: PresentEffect, height_m: float, shaft_input: Input
) -> str | None:
    """Why an FMU cannot have this effect; None if it can."""
    still = _stand(rig)
    alone = set_up(replace(rig, effects=(present,)), height_m, still)
    effect, _ = resolve_effect(present)
    if alone.sensor_changes:
        return "changes readings of the force sensor, and an FMU has the forces themselves"
    if alone.motion is not still:
        return "changes a motion that is known beforehand, and that of an FMU is its input"
    if effect.needs_order:
        return "depends on the number of strokes before, which an FMU does not count"
    if alone.drive is not None and shaft_input == "torque":
        return "is a drive between command and shaft, which --input torque replaces"
    return None


def _lay_out(setup: Setup, shaft_input: Input) -> MemoryLayout:
    """The block of numbers with the leg before its rest pose is known."""
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    start_rad = setup.motion.start_rad
    # One piece of motion at a time, which begins with a landing or has none.
    still = np.array([[start_rad, 0.0, 0.0, 0.0]])
    shaft = Shaft(np.zeros(2), still, np.zeros(1), False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if setup.drive is not None:
        shaft = add_drive(shaft, setup.drive, start_rad)
    elif shaft_input == "torque":
        shaft = shaft._replace(free=True)
    state = make_unloaded_state(chain, start_rad, laws)
    usual = Tolerance()
    memory = LegMemory(
        chain,
        laws,
        shaft,
        state,
        allocate_workspace_of(chain),
        allocate_samples(np.zeros(1), state.q.size, state.anchor.size),
        Stepping(
            span=np.zeros(2),
            next_step=np.zeros(1),
            longest_step=usual.longest_s,
            most_steps=float(usual.most_steps),
            tolerance=usual.bounds,
        ),
    )
    # Samples are not initialised; the file should not depend on what was in the memory.
    for column in memory.samples:
        column.fill(0.0)
    return lay_out(memory)


def _describe(
    model: LegModel, setup: Setup, layout: MemoryLayout, shaft_input: Input
) -> LegInterface:
    rig = model.rig
    parameters = _find_parameters(rig, setup.height_m, layout, shaft_input)
    content = hashlib.sha256(layout.numbers.tobytes())
    laws = setup.list_laws(setup.chain())
    names = [(use.law.__module__, use.law.__qualname__, use.place, use.only) for use in laws]
    for part in (names, parameters, shaft_input, rfca_rig.__version__, Path(CACHE_FOLDER).name):
        content.update(repr(part).encode())
    return LegInterface(
        title=model.title,
        source=model.source,
        input=SPEED_INPUT if shaft_input == "speed" else TORQUE_INPUT,
        outputs=list_outputs(len(rig.leg.link_lengths_m)),
        parameters=parameters,
        notes=_write_notes(rig, shaft_input),
        token=f"{{{content.hexdigest()[:32]}}}",
    )


@dataclass(frozen=True)
class _Candidate:
    """A value of the rig that could be open."""

    variable: Variable
    value: float
    least: float
    change: Callable[[RigModel, float], tuple[RigModel, float | None]]


def _change_leg(key: str) -> Callable[[RigModel, float], tuple[RigModel, float | None]]:
    def change(rig: RigModel, value: float) -> tuple[RigModel, float | None]:
        changed: dict[str, Any] = {key: value}
        return replace(rig, leg=replace(rig.leg, **changed)), None

    return change


def _change_ground(key: str) -> Callable[[RigModel, float], tuple[RigModel, float | None]]:
    def change(rig: RigModel, value: float) -> tuple[RigModel, float | None]:
        changed: dict[str, Any] = {key: value}
        return replace(rig, ground=replace(rig.ground, **changed)), None

    return change


def _list_candidates(rig: RigModel, height_m: float) -> list[_Candidate]:
    leg = rig.leg
    ground = rig.ground
    candidates = [
        _Candidate(
            Variable("height_m", "m", "Height of the shaft above the ground"),
            height_m,
            0.0,
            lambda rig, value: (rig, value),
        ),
        _Candidate(START_ANGLE, leg.start_angle_rad, -np.inf, _change_leg("start_angle_rad")),
        _Candidate(
            Variable("k0_Nm_per_rad", "N.m/rad", "Stiffness of a hinge at rest; scales its curve"),
            leg.k0_Nm_per_rad,
            0.0,
            _change_leg("k0_Nm_per_rad"),
        ),
        _Candidate(
            Variable("hinge_damping_Nm_s_per_rad", "N.m.s/rad", "Damping of a hinge"),
            leg.hinge_damping_Nm_s_per_rad,
            0.0,
            _change_leg("hinge_damping_Nm_s_per_rad"),
        ),
        _Candidate(
            Variable("contact_stiffness_N_per_m1p5", "N/m1.5", "Stiffness of the ground"),
            ground.stiffness_N_per_m1p5,
            0.0,
            _change_ground("stiffness_N_per_m1p5"),
        ),
        _Candidate(
            Variable("contact_damping_s_per_m", "s/m", "Damping of the ground"),
            ground.damping_s_per_m,
            0.0,
            _change_ground("damping_s_per_m"),
        ),
        _Candidate(
            Variable("friction_coefficient", "", "Coefficient of friction of the ground"),
            ground.friction_coefficient,
            0.0,
            _change_ground("friction_coefficient"),
        ),
    ]
    if not leg.torque_splines:
        k2 = Variable("k2_per_rad2", "1/rad2", "Hardening of a hinge: k0 phi (1 + k2 phi^2)")
        candidates.append(_Candidate(k2, leg.k2_per_rad2, -np.inf, _change_leg("k2_per_rad2")))
    return candidates


def _find_parameters(
    rig: RigModel, height_m: float, layout: MemoryLayout, shaft_input: Input
) -> tuple[OpenParameter, ...]:
    """The values that are open: those on which the numbers of the leg depend along straight lines,
    with all effects.
    """
    parameters = []
    taken: set[int] = set()
    for candidate in _list_candidates(rig, height_m):
        uses = _find_uses(rig, height_m, layout, shaft_input, candidate)
        places = {use.at for use in uses or ()}
        if uses is None or places & taken:
            # An effect computes something else from the value, so it stays as it is.
            continue
        taken |= places
        parameters.append(
            OpenParameter(candidate.variable, candidate.value, candidate.least, uses)
        )
    if shaft_input == "torque":
        rotor = layout.slot("shaft", "rotor").offset
        variable = Variable("rotor_kg_m2", "kg.m2", "Inertia of the drive, at the shaft")
        parameters.append(OpenParameter(variable, 0.0, 0.0, (Use(rotor, 0.0, 1.0),)))
    return tuple(parameters)


def _find_uses(
    rig: RigModel,
    height_m: float,
    layout: MemoryLayout,
    shaft_input: Input,
    candidate: _Candidate,
) -> tuple[Use, ...] | None:
    """How the numbers depend on a value; None where the dependence is not a straight line."""
    step = VARIATION * (abs(candidate.value) or 1.0)

    def numbers_at(value: float) -> Floats:
        changed, height = candidate.change(rig, value)
        setup = _set_up(changed, height_m if height is None else height)
        return _lay_out(setup, shaft_input).numbers

    here = layout.numbers
    further = numbers_at(candidate.value + step)
    nearer = numbers_at(candidate.value + 0.5 * step)
    if further.size != here.size or nearer.size != here.size:
        return None
    uses = []
    for at in np.flatnonzero((further != here) | (nearer != here)).tolist():
        # The program in C begins every simulation by writing these itself.
        if candidate.variable is START_ANGLE and _follows_start_angle(layout, at):
            continue
        slope = float(further[at] - here[at]) / step
        expected = here[at] + 0.5 * step * slope
        if not abs(nearer[at] - expected) <= STRAIGHT * max(abs(expected), abs(here[at])):
            return None
        uses.append(Use(at, float(here[at]) - slope * candidate.value, slope))
    return tuple(uses)


def _follows_start_angle(layout: MemoryLayout, at: int) -> bool:
    slots = [layout.slot("state", "q"), layout.slot("shaft", "coefficient")]
    slots.append(layout.slot("shaft", "angle"))
    return any(slot.offset <= at < slot.offset + slot.size for slot in slots)


def _write_notes(rig: RigModel, shaft_input: Input) -> tuple[str, ...]:
    """What a user of the model has to know."""
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
        "Sensor readings are exact: no noise, no lag, no rounding.",
    ]
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
        result = subprocess.run(  # noqa: S603
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

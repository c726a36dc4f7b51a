"""Variables of an exported leg, and the files of an FMU that describe it: modelDescription.xml,
documentation/index.html and the header of the program in C.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isinf

import rfca_rig
from rfca_rig.escaping import html_text
from rfca_rig.export.fmu_code import ADVANCE, LAW, MemoryLayout
from rfca_rig.model.kernel.laws import LawUse

# The file name of the binaries, which the standard wants as an identifier of C.
MODEL_IDENTIFIER = "flexible_leg"

# Value references. The program in C reads outputs by them, so that their order counts.
TIME = 0
INPUT = 1
OUTPUTS = 10
PARAMETERS = 1000

# Units as exponents of SI base units and rad. Base units have whole exponents, which N/m^1.5 lacks.
UNITS: dict[str, dict[str, int] | None] = {
    "s": {"s": 1},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "1/rad2": {"rad": -2},
    "s/m": {"s": 1, "m": -1},
    "kg.m2": {"kg": 1, "m": 2},
    "N/m1.5": None,
}
# What a person rather reads: the unit, and its number per SI unit.
DISPLAY_UNITS = {"rad": ("deg", 57.29577951308232), "m": ("mm", 1000.0)}


@dataclass(frozen=True)
class Variable:
    """An input or output. `name` carries the unit, `constant` is its name in C; `unit` is one of
    `UNITS` or "".
    """

    name: str
    unit: str
    description: str
    constant: str = ""


@dataclass(frozen=True)
class Use:
    """A number of the compiled leg that follows from a parameter: intercept + slope * value, at
    this index of its block.
    """

    at: int
    intercept: float
    slope: float


@dataclass(frozen=True)
class OpenParameter:
    """A value that may be changed before a simulation: its value in the rig, its least value, and
    where it acts.
    """

    variable: Variable
    start: float
    least: float
    uses: tuple[Use, ...]


@dataclass(frozen=True)
class LegInterface:
    """What the files describe.

    Parameters
    ----------
    title
        Of the rig.
    source
        Lines about where the model comes from, name and value.
    input
        The shaft's command.
    outputs
        In the order of their value references.
    parameters
        Those that are open.
    notes
        What the model does and does not contain, in sentences.
    token
        Identifies the binaries that belong to the description.
    """

    title: str
    source: Mapping[str, str]
    input: Variable
    outputs: tuple[Variable, ...]
    parameters: tuple[OpenParameter, ...]
    notes: tuple[str, ...]
    token: str


SPEED_INPUT = Variable(
    "commanded_rad_s",
    "rad/s",
    "Commanded speed of the shaft, reached at the end of the communication step with constant "
    "acceleration",
)
TORQUE_INPUT = Variable(
    "drive_torque_Nm",
    "N.m",
    "Torque of the drive on the shaft, positive downwards, constant during the communication step",
)
START_ANGLE = Variable(
    "start_angle_rad", "rad", "Angle of the shaft at the start, from the horizontal, downwards"
)


def list_outputs(links: int) -> tuple[Variable, ...]:
    """The outputs of a leg with so many links."""
    outputs = (
        Variable("shaft_rad", "rad", "Angle of the shaft, from the horizontal, downwards", "SHAFT"),
        Variable("shaft_rad_s", "rad/s", "Speed of the shaft", "SHAFT_SPEED"),
        Variable("shaft_torque_Nm", "N.m", "Torque of the shaft on the leg", "SHAFT_TORQUE"),
        Variable("fy_N", "N", "Force along the ground, in the axes of the sensor", "FY"),
        Variable(
            "fz_N",
            "N",
            "Vertical force, in the axes of the sensor: negative where the ground pushes the leg "
            "up, positive under the weight alone",
            "FZ",
        ),
        Variable("tx_Nm", "N.m", "Torque at the sensor, which sits below the shaft", "TX"),
        Variable(
            "contact_normal_N",
            "N",
            "Normal force of the ground, over the ends of all links",
            "NORMAL",
        ),
        Variable(
            "contact_friction_N",
            "N",
            "Friction of the ground, over the ends of all links",
            "TANGENTIAL",
        ),
    )
    hinges = [
        Variable(
            f"hinge_{hinge}_rad",
            "rad",
            f"Angle of hinge {hinge}: of link {hinge} from link {hinge - 1}",
        )
        for hinge in range(2, links + 1)
    ]
    return (*outputs, *hinges)


def write_description(interface: LegInterface) -> str:
    """modelDescription.xml of FMI 3.0."""
    count = len(interface.outputs)
    references = range(OUTPUTS, OUTPUTS + count)
    source = "; ".join(f"{name} {value}" for name, value in interface.source.items())
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<fmiModelDescription fmiVersion="3.0"',
        f'  modelName="{_attribute(interface.title)}: flexible leg"',
        f'  instantiationToken="{interface.token}"',
        f'  description="Flexible leg on a shaft with contact to the ground; {_attribute(source)}"',
        '  license="MIT"',
        f'  generationTool="rfca-rig {rfca_rig.__version__}"',
        '  variableNamingConvention="flat">',
        f'  <CoSimulation modelIdentifier="{MODEL_IDENTIFIER}"',
        '    canHandleVariableCommunicationStepSize="true"',
        '    canGetAndSetFMUState="true" canSerializeFMUState="true"/>',
        "  <UnitDefinitions>",
        *_list_units(),
        "  </UnitDefinitions>",
        '  <LogCategories><Category name="logStatusError"/></LogCategories>',
        '  <DefaultExperiment startTime="0" stopTime="1" tolerance="1e-5" stepSize="1e-3"/>',
        "  <ModelVariables>",
        _variable(
            Variable("time", "s", "Time"),
            TIME,
            {"causality": "independent", "variability": "continuous"},
        ),
        _variable(
            interface.input,
            INPUT,
            {"causality": "input", "variability": "continuous", "start": "0"},
        ),
    ]
    for reference, output in zip(references, interface.outputs, strict=True):
        lines.append(
            _variable(output, reference, {"causality": "output", "variability": "continuous"})
        )
    for reference, parameter in enumerate(interface.parameters, start=PARAMETERS):
        keys = {"causality": "parameter", "variability": "fixed", "start": repr(parameter.start)}
        if not isinf(parameter.least):
            keys["min"] = repr(parameter.least)
        lines.append(_variable(parameter.variable, reference, keys))
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    lines += [f'    <Output valueReference="{reference}"/>' for reference in references]
    lines += [f'    <InitialUnknown valueReference="{reference}"/>' for reference in references]
    lines += ["  </ModelStructure>", "</fmiModelDescription>"]
    return "\n".join(lines) + "\n"


def _list_units() -> list[str]:
    lines = []
    for name, exponents in UNITS.items():
        content = ""
        if exponents is not None:
            powers = " ".join(f'{base}="{power}"' for base, power in exponents.items())
            content += f"<BaseUnit {powers}/>"
        if name in DISPLAY_UNITS:
            display, factor = DISPLAY_UNITS[name]
            content += f'<DisplayUnit name="{display}" factor="{factor!r}"/>'
        lines.append(f'    <Unit name="{name}">{content}</Unit>')
    return lines


def _variable(variable: Variable, reference: int, keys: Mapping[str, str]) -> str:
    keys = {"name": variable.name, "valueReference": str(reference), **keys}
    if variable.unit:
        keys["unit"] = variable.unit
    if variable.unit in DISPLAY_UNITS:
        keys["displayUnit"] = DISPLAY_UNITS[variable.unit][0]
    keys["description"] = variable.description
    text = " ".join(f'{key}="{_attribute(value)}"' for key, value in keys.items())
    return f"    <Float64 {text}/>"


def _attribute(text: str) -> str:
    return html_text(text)


def write_documentation(interface: LegInterface) -> str:
    """documentation/index.html: what the model contains, how it takes its steps, and its limits."""
    rows = [_row(interface.input, "input", "")]
    rows += [_row(output, "output", "") for output in interface.outputs]
    rows += [
        _row(parameter.variable, "parameter", f"{parameter.start:.6g}")
        for parameter in interface.parameters
    ]
    source = [
        f"<li>{html_text(name)}: {html_text(value)}</li>"
        for name, value in interface.source.items()
    ]
    notes = [f"<li>{html_text(note)}</li>" for note in interface.notes]
    title = html_text(interface.title)
    return "\n".join(
        [
            "<!DOCTYPE html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title></head><body>',
            f"<h1>{title}: flexible leg</h1>",
            f"<p>FMI 3.0 for co-simulation, made by rfca-rig {rfca_rig.__version__}.</p>",
            "<h2>Source</h2><ul>",
            *source,
            "</ul><h2>Model and limits</h2><ul>",
            *notes,
            "</ul><h2>Variables</h2><table>",
            "<tr><th>name</th><th>kind</th><th>unit</th><th>start</th><th>meaning</th></tr>",
            *rows,
            "</table></body></html>",
            "",
        ]
    )


def _row(variable: Variable, kind: str, start: str) -> str:
    cells = (variable.name, kind, variable.unit, start, variable.description)
    return "<tr>" + "".join(f"<td>{html_text(cell)}</td>" for cell in cells) + "</tr>"


# Names in C of the places in the block of numbers.
_PLACES = {
    "AT_REST": ("chain", "rest"),
    "AT_MU": ("chain", "mu"),
    "AT_DRAG": ("chain", "drag"),
    "AT_BREAKS": ("shaft", "breaks"),
    "AT_COEFFICIENT": ("shaft", "coefficient"),
    "AT_LANDINGS": ("shaft", "landings"),
    "AT_SHAFT_FREE": ("shaft", "free"),
    "AT_SHAFT_FEED": ("shaft", "feed"),
    "AT_SHAFT_ANGLE": ("shaft", "angle"),
    "AT_SHAFT_GAP": ("shaft", "gap"),
    "AT_Q": ("state", "q"),
    "AT_W": ("state", "w"),
    "AT_A": ("state", "a"),
    "AT_ANCHOR": ("state", "anchor"),
    "AT_MEMORY": ("state", "memory"),
    "AT_ENDS": ("work", "ends"),
    "AT_SAMPLE_TIME": ("samples", "t"),
    "AT_FORCE": ("samples", "force"),
    "AT_CONTACT": ("samples", "contact"),
    "AT_SPAN": ("stepping", "span"),
    "AT_NEXT_STEP": ("stepping", "next_step"),
    "AT_TOLERANCE": ("stepping", "tolerance"),
}


@dataclass(frozen=True)
class LegProgram:
    """What the program in C needs to know beside the interface.

    `drive_sags` and `drive_holds` say how a compliant drive carries the weight of the leg at the
    start, see `setup.CompliantDrive`; both are false without one.
    """

    layout: MemoryLayout
    laws: tuple[LawUse, ...]
    drive_sags: bool
    drive_holds: bool
    below_shaft_m: float
    start_angle_rad: float


def write_header(interface: LegInterface, program: LegProgram) -> str:
    """leg.h, which fmu_interface.c includes."""
    layout = program.layout
    links = layout.slot("state", "anchor").size
    sizes = {
        "NUMBERS": layout.numbers.size,
        # An array of C has at least one element.
        "INTEGERS": max(layout.integers.size, 1),
        "LINKS": links,
        "COORDINATES": layout.slot("state", "q").size,
        "MEMORY": layout.slot("state", "memory").size,
        "ENDS": layout.slot("work", "ends").size,
        "PARAMETERS": len(interface.parameters),
        "USES": sum(len(parameter.uses) for parameter in interface.parameters),
        "INPUT_IS_TORQUE": int(interface.input is TORQUE_INPUT),
        "DRIVE_SAGS": int(program.drive_sags),
        "DRIVE_HOLDS": int(program.drive_holds),
        "VARIABLE_TIME": TIME,
        "VARIABLE_INPUT": INPUT,
        "VARIABLE_PARAMETERS": PARAMETERS,
        "VARIABLE_HINGES": OUTPUTS + len(interface.outputs) - (links - 1),
        "VARIABLE_END": OUTPUTS + len(interface.outputs),
    }
    for reference, output in enumerate(interface.outputs, start=OUTPUTS):
        if output.constant:
            sizes[f"VARIABLE_{output.constant}"] = reference
    for name, (part, field) in _PLACES.items():
        sizes[name] = layout.slot(part, field).offset
    lines = [
        f"/* A leg for fmu_interface.c, written by rfca-rig {rfca_rig.__version__}. */",
        "#ifndef LEG_H",
        "#define LEG_H",
        "",
        *(f"#define {name} {value}" for name, value in sizes.items()),
        f"#define BELOW_SHAFT_M {_number(program.below_shaft_m)}",
        _define_start_angle(interface, program),
        f'#define INSTANTIATION_TOKEN "{interface.token}"',
        "",
        "typedef struct {",
        "    const char *name;",
        "    double start;",
        "    double min;",
        "} Parameter;",
        "",
        "static const Parameter LEG_PARAMETERS[PARAMETERS] = {",
        *_list_parameters(interface.parameters),
        "};",
        "",
        "/* A number that follows from a parameter: intercept + slope * value. */",
        "typedef struct {",
        "    int parameter;",
        "    int at;",
        "    double intercept;",
        "    double slope;",
        "} Use;",
        "",
        "static const Use LEG_USES[USES] = {",
        *_list_uses(interface.parameters),
        "};",
        "",
        "static const double LEG_NUMBERS[NUMBERS] = {",
        *(f"    {_number(value)}," for value in layout.numbers.tolist()),
        "};",
        "",
        *_write_laws(program),
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _define_start_angle(interface: LegInterface, program: LegProgram) -> str:
    """The start angle of the shaft as a parameter, or as a number where it is not open."""
    value = _number(program.start_angle_rad)
    for number, parameter in enumerate(interface.parameters):
        if parameter.variable is START_ANGLE:
            value = f"((parameters)[{number}])"
    return f"#define START_ANGLE_RAD(parameters) {value}"


def _list_parameters(parameters: Sequence[OpenParameter]) -> list[str]:
    return [
        f'    {{"{parameter.variable.name}", {_number(parameter.start)}, '
        f"{_number(parameter.least)}}},"
        for parameter in parameters
    ]


def _list_uses(parameters: Sequence[OpenParameter]) -> list[str]:
    lines = []
    for number, parameter in enumerate(parameters):
        for use in parameter.uses:
            lines.append(
                f"    {{{number}, {use.at}, {_number(use.intercept)}, {_number(use.slope)}}},"
            )
    return lines


def _write_laws(program: LegProgram) -> list[str]:
    """Declarations of the laws, and the function that fills the block of integers: addresses of
    this process, places, and hinges.
    """
    layout = program.layout
    lines = []
    addresses = {}
    for number, use in enumerate(program.laws):
        addresses[layout.slot("laws", "address").offset + number] = f"{LAW}{number}"
        if use.advance:
            addresses[layout.slot("laws", "advance").offset + number] = f"{ADVANCE}{number}"
    for name in addresses.values():
        lines.append(f"void {name}(double *x, double *memory, double *parameter, double *out);")
    lines += ["", "static void leg_fill_integers(int64_t *integers)", "{"]
    values = layout.integers.tolist()
    if not values:
        lines.append("    integers[0] = 0;")
    for index, value in enumerate(values):
        if index in addresses:
            lines.append(f"    integers[{index}] = (int64_t)(intptr_t)&{addresses[index]};")
        else:
            lines.append(f"    integers[{index}] = {value};")
    return [*lines, "}"]


def _number(value: float) -> str:
    """A number of C, to its last digit."""
    if isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return value.hex()

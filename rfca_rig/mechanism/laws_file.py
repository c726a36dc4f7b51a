"""Writes `laws.py`: the laws of a plant that MJCF cannot express, as plain Python functions for the
user's own MuJoCo loop.

The file needs only numpy. It has the same formulas as `rollout`, with the values of one plant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.escaping import python_docstring
from rfca_rig.mechanism.plant import Plant
from rfca_rig.recording.atomic import write_atomically

Floats = NDArray[np.float64]

# Significant digits of the numbers in the file: short to read, and far below any uncertainty of a
# fitted value.
DIGITS = 9


def write_laws(
    plant: Plant, beyond: Sequence[str], path: Path, stated: Sequence[str], model_file: str
) -> bool:
    """Writes the file, or removes one of an earlier diagnosis where MJCF can express everything.

    Parameters
    ----------
    plant
        The mechanism with nuisance parameters and effects.
    beyond
        Laws that MJCF cannot express, as `write_amended_model` lists them.
    path
        Of the file, which is written atomically.
    stated
        Result of the diagnosis, in lines, for the head of the file.
    model_file
        Name of the model file in the same folder.

    Returns
    -------
    bool
        Whether there is a file.
    """
    # A file of an earlier diagnosis beside a new model would state wrong laws.
    if not beyond:
        path.unlink(missing_ok=True)
        return False
    write_atomically(path, _text(plant, beyond, stated, model_file, path.stem).encode("utf-8"))
    return True


def _text(
    plant: Plant, beyond: Sequence[str], stated: Sequence[str], model_file: str, module: str
) -> str:
    # Several entries may need the same function; `dict.fromkeys` keeps the first of each, in order.
    makers = dict.fromkeys(PARTS[words] for words in beyond if words in PARTS)
    parts = [make(plant) for make in makers]
    missing = [words for words in beyond if words not in PARTS]
    acts = [line for part in parts for line in part.act.strip("\n").splitlines()]
    head = [
        (
            f"What {model_file} lacks of the mechanism, because MJCF does not hold it. "
            "Functions of numpy arrays, one entry per joint."
        ),
        "",
        *stated,
        *(f"NOT in this file: {words}" for words in missing),
        *([""] if stated or missing else []),
        f"Joints, in this order: {', '.join(plant.mechanism.joints)}.",
        "Units are SI: torques in N m, forces of slides in N, angles in rad, distances in m.",
        (
            f"The values were fitted with the integrator RK4 and steps of {plant.step_s:g} s "
            "(model.opt.timestep, model.opt.integrator)."
        ),
        *(
            _example(module, model_file, any(part.commands for part in parts))
            if acts or any(part.commands for part in parts)
            else []
        ),
    ]
    body = [line for part in parts for line in ("", "", *part.code.strip("\n").splitlines())]
    # Names and results are text here: none may end the docstring, of the program's lines or of a
    # stranger's model.
    docstring = [python_docstring(line) for line in head]
    return "\n".join(
        [
            '"""' + docstring[0],
            *docstring[1:],
            '"""',
            "",
            "import numpy as np",
            *body,
            *(_act(acts) if acts else []),
            "",
        ]
    )


@dataclass(frozen=True)
class _Part:
    """Code of one function, its lines in `act`, and whether it changes commands."""

    code: str
    act: str = ""
    commands: bool = False


def _example(module: str, model_file: str, shapes_commands: bool) -> list[str]:
    if shapes_commands:
        shaped = [f"    ctrl = {module}.shape_commands(t_s, recorded, model.opt.timestep, steps)"]
    else:
        shaped = []
    return [
        "",
        "    import mujoco",
        f"    import {module}",
        "",
        f'    model = mujoco.MjModel.from_xml_path("{model_file}")',
        "    data = mujoco.MjData(model)  # set qpos and qvel here",
        *shaped,
        "    data.ctrl[:] = ctrl[0]",
        "    mujoco.mj_forward(model, data)",
        f"    state = {module}.start(model)",
        "    for k in range(steps):",
        "        data.ctrl[:] = ctrl[k]",
        f"        {module}.act(model, data, state)",
        "        mujoco.mj_step(model, data)",
        *(
            ["", "Where the file has no `act`, leave out both lines with `state`."]
            if shapes_commands
            else []
        ),
    ]


def _act(acts: Sequence[str]) -> list[str]:
    return f'''

def start(model):
    """The state that `act` needs: the dry friction of the model file, and the bristles of hysteresis."""
    return {{"frictionloss": model.dof_frictionloss.copy(), "bristle": np.zeros(model.nv)}}


def act(model, data, state):
    """Call it before each mj_step: it sets model.dof_frictionloss and data.qfrc_applied.

    Dry friction goes into dof_frictionloss, where it sticks at rest. As a torque, -friction * sign(speed), it would not.
    """
    speed, position, h = data.qvel, data.qpos, model.opt.timestep
    friction, torque = state["frictionloss"].copy(), np.zeros(model.nv)
{chr(10).join(acts)}
    model.dof_frictionloss[:], data.qfrc_applied[:] = friction, torque
'''.rstrip().splitlines()


def _numbers(values: Floats) -> str:
    """Numbers as a Python list."""

    def write(x: float) -> str:
        return f"{x:.{DIGITS}g}"

    return f"[{', '.join(map(write, values.tolist()))}]"


def _array(values: Floats) -> str:
    # An unlimited command has the limit inf, which is no name of Python.
    return f"np.array({_numbers(values)})".replace("inf", "np.inf")


def _per_joint(plant: Plant, line: Callable[[int], str], acts: NDArray[np.bool_]) -> str:
    return "\n".join(
        f"    {python_docstring(name)}: {line(joint)}"
        for joint, name in enumerate(plant.mechanism.joints)
        if acts[joint]
    )


def _speed_unit(plant: Plant, joint: int) -> str:
    if plant.mechanism.is_slide[joint]:
        return "m/s"
    return "rad/s"


def _unit(plant: Plant, joint: int) -> str:
    if plant.mechanism.is_slide[joint]:
        return "N"
    return "N m"


def _stribeck(plant: Plant) -> _Part:
    torque, rise, falls = plant.stribeck
    values = _per_joint(
        plant,
        lambda j: (
            f"T_c = {torque[j]:.4g} {_unit(plant, j)}, rise = {rise[j]:.4g}, w_s = "
            f"{falls[j]:.4g} {_speed_unit(plant, j)}"
        ),
        torque > 0.0,
    )
    return _Part(
        f'''
def stribeck_friction(speed):
    """Dry friction that falls with speed, of each joint: T = T_c (1 + rise exp(-|w| / w_s)).

{values}

    Source: Stribeck 1902, exponential form.
    """
    torque = {_array(torque)}
    rise = {_array(rise)}
    falls_with = {_array(falls)}
    return torque * (1.0 + rise * np.exp(-np.abs(speed) / falls_with))
''',
        "    friction += stribeck_friction(speed)",
    )


def _load(plant: Plant) -> _Part:
    values = _per_joint(plant, lambda j: f"loss = {plant.load_loss[j]:.4g}", plant.load_loss != 0.0)
    return _Part(
        f'''
def load_friction(actuator_torque):
    """Dry friction of each joint that grows with the torque of its actuator, data.qfrc_actuator: T = loss |tau|.

{values}

    Source: Hamon, Gautier and Garrec, IROS 2010.
    """
    return {_array(plant.load_loss)} * np.abs(actuator_torque)
''',
        "    friction += load_friction(data.qfrc_actuator)",
    )


def _hysteresis(plant: Plant) -> _Part:
    torque, bend = plant.hysteresis
    values = _per_joint(
        plant,
        lambda j: (
            f"T_h = {torque[j]:.4g} {_unit(plant, j)}, b = {bend[j]:.4g} "
            f"{'m' if plant.mechanism.is_slide[j] else 'rad'}"
        ),
        torque > 0.0,
    )
    return _Part(
        f'''
def hysteresis(bristle, speed, step_s):
    """Friction that builds up over an angle: T = T_h z, z' = (w / b) (1 - z sgn(w)); resists a positive speed.

{values}

    Source: Dahl 1968. Takes z at the beginning of a step, returns the mean torque over the step, and z at its end.
    """
    torque = {_array(torque)}
    bend = {_array(bend)}
    slip = step_s * speed / bend
    towards = np.where(slip > 0.0, 1.0, -1.0)
    after = towards + (bristle - towards) * np.exp(-np.abs(slip))
    return torque * 0.5 * (bristle + after), after
''',
        """
    resists, state["bristle"] = hysteresis(state["bristle"], speed, h)
    torque -= resists
""",
    )


def _offset(plant: Plant) -> _Part:
    return _Part(
        f'''
def steady_torque():
    """A steady torque in each joint, as found: [{", ".join(f"{value:.4g}" for value in plant.torque_offset)}]."""
    return {_array(plant.torque_offset)}
''',
        "    torque += steady_torque()",
    )


def _tables(plant: Plant) -> _Part:
    code: list[str] = []
    act: list[str] = []
    for number, law in enumerate(plant.laws, start=1):
        if len(plant.laws) == 1:
            name = "measured_law"
        else:
            name = f"measured_law_{number}"
        joint = python_docstring(plant.mechanism.joints[law.joint])
        slides = bool(plant.mechanism.is_slide[law.joint])
        if law.by_speed:
            quantity = "speed"
            unit = _speed_unit(plant, law.joint)
        else:
            quantity = "position"
            unit = "m" if slides else "rad"
        code.append(
            f'''
def {name}({quantity}):
    """The torque in {joint} [{_unit(plant, law.joint)}] that resists a positive {quantity} [{unit}], as measured.

    Straight between the knots, constant beyond {law.knots[0]:.4g} and {law.knots[-1]:.4g} {unit}.
    """
    knots = {_array(law.knots)}
    values = {_array(law.values)}
    return np.interp({quantity}, knots, values)
'''.strip("\n")
        )
        # The same treatment as in `rollout.act_tables`.
        j = law.joint
        if law.by_speed:
            act += [
                f"    towards = 1.0 if speed[{j}] > 0.0 else -1.0",
                (
                    f"    brakes = friction[{j}] + {name}(speed[{j}]) * towards  # what "
                    "brakes acts as dry friction"
                ),
                f"    friction[{j}] = max(brakes, 0.0)",
                f"    torque[{j}] -= min(brakes, 0.0) * towards",
            ]
        else:
            act += [f"    torque[{j}] -= {name}(position[{j}] + 0.5 * h * speed[{j}])"]
    return _Part("\n\n\n".join(code), "\n".join(act))


def _commands(plant: Plant) -> _Part:
    names = python_docstring(", ".join(plant.mechanism.actuators))
    return _Part(
        f'''
def shape_commands(t_s, command, step_s, steps, since_s=0.0):
    """What acts in each of `steps` steps from time 0 on, (steps, u), of commands (k, u) that were recorded at `t_s` (k,).

    Delay {plant.command_delay_s:.4g} s, lag {plant.command_lag_s:.4g} s, clock rate {plant.command_clock_rate:.4g}; the recording began
    `since_s` before time 0. Dead band {_numbers(plant.command_dead_band)} and limit {_numbers(plant.command_limit)} of the command times
    the gain {_numbers(plant.command_gain)}, which the actuators of the model file have already. Actuators: {names}.
    """
    t_s, command = np.asarray(t_s, dtype=float), np.asarray(command, dtype=float)
    gain, dead_band, limit = {_array(plant.command_gain)}, {_array(plant.command_dead_band)}, {_array(plant.command_limit)}
    delay_s, lag_s, clock_rate = {plant.command_delay_s:.{DIGITS}g}, {plant.command_lag_s:.{DIGITS}g}, {plant.command_clock_rate:.{DIGITS}g}
    before = int(max(0.0, -t_s[0] / step_s)) if lag_s > 0.0 else 0
    edges = np.arange(-before, steps + 1) * step_s
    edges = edges - delay_s - clock_rate * (since_s + edges)
    spans = 0.5 * np.diff(t_s)[:, None] * (command[1:] + command[:-1])
    total = np.vstack([np.zeros(command.shape[1]), np.cumsum(spans, axis=0)])
    beyond = np.minimum(edges - t_s[0], 0.0)[:, None] * command[0] + np.maximum(edges - t_s[-1], 0.0)[:, None] * command[-1]
    sums = np.column_stack([np.interp(edges, t_s, column) for column in total.T]) + beyond
    mean = np.diff(sums, axis=0) / np.diff(edges)[:, None]
    if lag_s > 0.0:
        share = 1.0 - np.exp(-step_s / lag_s)
        for k in range(1, len(mean)):
            mean[k] = mean[k - 1] + share * (mean[k] - mean[k - 1])
        mean[1:] = 0.5 * (mean[1:] + mean[:-1])
    scaled = mean[before:] * gain
    scaled = np.sign(scaled) * np.maximum(np.abs(scaled) - dead_band, 0.0)
    return np.clip(scaled, -limit, limit) / gain
''',
        commands=True,
    )


def _positions(plant: Plant) -> _Part:
    return _Part(f'''
def read_positions(position):
    """The readings of positions (..., n): each encoder reads so much too large."""
    return position + {_array(plant.zero_offset)}
''')


def _late_states(plant: Plant) -> _Part:
    return _Part(_late("read_states_late", "positions or speeds", plant.reading_lag_s))


def _speeds(plant: Plant) -> _Part:
    return _Part(_late("read_speeds", "speeds", plant.speed_lag_s))


def _late(name: str, what: str, lag_s: float) -> str:
    """A function that reads states through a first-order lag."""
    return f'''
def {name}(state, step_s):
    """The readings of {what} (k, n), one per step: behind a lag of {lag_s:.4g} s, which the motion has reached before it begins."""
    lag_s = {lag_s:.{DIGITS}g}
    read = np.array(state, dtype=float)
    if len(read) > 2:
        rate = (-3.0 * read[0] + 4.0 * read[1] - read[2]) / (2.0 * step_s)
        bend = (read[0] - 2.0 * read[1] + read[2]) / step_s**2
        read[0] += lag_s * (lag_s * bend - rate)
    remains = np.exp(-step_s / lag_s)
    new = 1.0 - lag_s / step_s * (1.0 - remains)  # exact for states that are straight lines between the rows
    for k in range(1, len(read)):
        read[k] = remains * read[k - 1] + new * state[k] + (1.0 - remains - new) * state[k - 1]
    return read
'''


def _sensors(plant: Plant) -> _Part:
    pairs = np.argwhere(plant.sensor_crosstalk)
    leaks = "".join(
        f"    leaks[{i}, {j}] = {plant.sensor_crosstalk[i, j]:.{DIGITS}g}\n" for i, j in pairs
    )
    return _Part(f'''
def read_sensors(sensordata, step_s, since_s=0.0):
    """The readings of data.sensordata (k, d), one per step from time 0 on. Lag {plant.sensor_lag_s:.4g} s, delay
    {plant.sensor_delay_s:.4g} s, crosstalk, factor, zero and drift of each value; the recording began `since_s` before time 0.
    """
    factor, zero = {_array(plant.sensor_gain)}, {_array(plant.sensor_offset)}
    drift_per_s = {_array(plant.sensor_drift_per_s)}
    lag_s, delay_s = {plant.sensor_lag_s:.{DIGITS}g}, {plant.sensor_delay_s:.{DIGITS}g}
    leaks = np.zeros(({len(plant.sensor_gain)}, {len(plant.sensor_gain)}))  # value i reads leaks[i, j] of value j
{leaks}    read, t_s = np.array(sensordata, dtype=float), np.arange(len(sensordata)) * step_s
    if lag_s > 0.0:
        remains = np.exp(-step_s / lag_s)
        new = 1.0 - lag_s / step_s * (1.0 - remains)  # exact for values that are straight lines between the rows
        for k in range(1, len(read)):
            read[k] = remains * read[k - 1] + new * sensordata[k] + (1.0 - remains - new) * sensordata[k - 1]
    read = np.column_stack([np.interp(t_s - delay_s, t_s, column) for column in read.T])
    read = read + read @ leaks.T
    return read * factor + zero + (since_s + t_s)[:, None] * drift_per_s
''')


# Keys are the texts of `write_amended_model`. Several texts may share one function, which is
# written once.
PARTS: dict[str, Callable[[Plant], _Part]] = {
    "friction that falls with speed": _stribeck,
    "friction that grows with load": _load,
    "hysteresis of the joints": _hysteresis,
    "steady torques in the joints": _offset,
    "measured laws": _tables,
    "zero offsets of the readings": _positions,
    "saturation of the commands": _commands,
    "dead band of the commands": _commands,
    "delay, lag or clock of the commands": _commands,
    "lag of the readings of the joints": _late_states,
    "lag of the speed readings": _speeds,
    "scales and zeros of the sensors": _sensors,
    "crosstalk of the sensors": _sensors,
    "delay or lag of the sensors": _sensors,
}

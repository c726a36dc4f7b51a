"""MuJoCo's own system identification on the same windows: python -m tests.real.sysid FOLDER
[SET...]

FOLDER is that of `python -m tests.real`; the toolbox needs `pip install 'mujoco[sysid]'`. The right
parameters are freed by hand, as it asks for: those of the published law, and masses, inertias and
centres of mass where [known_to] lists them. Offsets and delays are not freed. The toolbox starts
each window from the measured state, and is scored as the other fits are: one condition is held out
at a time, and the start of a held-out window is moved within its uncertainty.

Steps are those of the diagnosis, with MuJoCo's Runge-Kutta integrator. All windows of a fit go
through one call: one call for each compiles the model and starts threads each time.
"""

import io
import json
import sys
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.mechanisms.prepared import prepare_mechanism
from rfca_rig.mechanism.load import ARENA_BYTES, load_mechanism
from rfca_rig.public_data.registry import read_registry
from tests.real.hand_fit import Fit, list_free

OF_BODIES = ("mass_relative", "centre_of_mass_m", "inertia_relative")
OF_JOINTS = ("joint_friction", "joint_damping", "rotor_inertia")
WIDEST = 5.0  # scales of the hand fit: the bounds of a parameter
ITERATIONS = 40
STEP = 1e-3  # of finite differences, as the hand fit has it


def keys_of(described, experiment):
    """The keys of [known_to] that are freed."""
    of_bodies = [key for key in OF_BODIES if key in experiment.known_to]
    return list(
        dict.fromkeys(
            [
                key
                for key in [*described.law, *of_bodies]
                if key in OF_BODIES or key.startswith(OF_JOINTS)
            ]
        )
    )


def spec_of(path, step_s):
    """The model with a sensor for the position of every joint, and bodies whose inertia does not
    follow from geoms.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    model = spec.compile()
    spec.memory = ARENA_BYTES
    spec.option.timestep = step_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for place, body in enumerate(spec.bodies):
        if model.body_mass[place] > 0.0:
            body.explicitinertial = True
            body.fullinertia = np.full(6, np.nan)
            body.mass = model.body_mass[place]
            body.inertia = model.body_inertia[place]
            body.ipos = model.body_ipos[place]
            body.iquat = model.body_iquat[place]
    for joint in spec.joints:
        spec.add_sensor(
            name=f"{joint.name}_read",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
        )
    return spec


def parameters_of(spec, free, scales):
    """The freed parameters as the toolbox has them, in their scales; masses scale with their
    inertia.
    """
    nominal = {
        body.name: (body.mass, np.array(body.inertia), np.array(body.ipos)) for body in spec.bodies
    }

    def modifier(one):
        object_name = one.name.rsplit(".", 1)[0]

        def change(changed, parameter):
            value = one.scale * float(np.ravel(parameter.value)[0])
            if one.key in OF_BODIES:
                body = changed.body(object_name)
                (mass, inertia, at) = nominal[object_name]
                if one.key == "mass_relative":
                    body.mass = mass * (1.0 + value)
                    body.inertia = inertia * (1.0 + value)
                elif one.key == "inertia_relative":
                    body.inertia = inertia * (1.0 + value)
                else:
                    body.ipos = at * (1.0 + value / np.linalg.norm(at))
            elif one.key.startswith("joint_friction"):
                changed.joint(object_name).frictionloss = value
            elif one.key.startswith("joint_damping"):
                changed.joint(object_name).damping = [value, 0.0, 0.0]
            else:
                changed.joint(object_name).armature = value

        return change

    found = sysid.ParameterDict()
    for one, scale in zip(free, scales, strict=True):
        least = max(one.least / scale, -WIDEST)
        found.add(
            sysid.Parameter(one.name, max(0.0, least) + 0.1, least, WIDEST, modifier=modifier(one))
        )
    return found


def measure_and_drive(problem, model, conditions):
    """Initial states, commands and readings of all windows of these conditions, all of one
    length.
    """
    windows = [each.window for condition in conditions for each in condition.windows]
    columns = problem.simulator.columns
    joints = len(problem.simulator.mechanism.joints)
    first = [int(np.flatnonzero(columns == joint)[0]) for joint in range(joints)]
    longest_s = max(window.t_s[-1] for window in windows)
    t_s = np.arange(0.0, longest_s + 1.5 * model.opt.timestep, model.opt.timestep)
    middle_s = t_s + 0.5 * model.opt.timestep  # the toolbox holds a command over its step
    found = []
    for window in windows:
        command = np.zeros((len(t_s), model.nu))
        for place, column in enumerate(window.trace.command.T):
            command[:, place] = np.interp(middle_s, window.trace.t_s, column)
        means_s = np.array([part.mean() for part in np.split(window.t_s, window.bins[1:])])
        state = sysid.create_initial_state(model, window.position, window.speed)
        reading = sysid.TimeSeries.from_names(means_s, window.measured[first].T, model)
        found.append(
            sysid.SystemTrajectory(model, sysid.TimeSeries(t_s, command), reading, state, None)
        )
    return found


def subtract(_params, predicted, measured, _model, _all, **_kwargs):
    """Plain differences: the toolbox's own weights make a window around zero count most."""
    predicted = predicted.resample(measured.times)
    return predicted.data - measured.data, predicted, measured


def fit(problem, path, free, conditions):
    """The values of the free parameters (p,), in their scales, that the toolbox finds on these
    conditions.
    """
    spec = spec_of(path, problem.simulator.step_s)
    trajectories = measure_and_drive(problem, spec.compile(), conditions)
    bins = [len(trajectory.sensordata.times) for trajectory in trajectories]
    by_length = []
    for length in set(bins):
        alike = [
            trajectory for trajectory, n in zip(trajectories, bins, strict=True) if n == length
        ]
        by_length.append(alike)

    def residual_at(x, params):
        build = lambda changed: sysid.apply_param_modifiers(changed, spec)  # noqa: E731
        groups = [
            sysid.model_residual(
                x, params, build, alike, subtract, n_threads=1, resample_true=False
            )
            for alike in by_length
        ]
        return np.concatenate([np.ravel(group[0]) for group in groups])

    def residual(x, params):
        columns = [residual_at(column, params) for column in np.reshape(x, (len(free), -1)).T]
        return [columns[0] if np.ndim(x) == 1 else np.column_stack(columns)], None, None

    parameters = parameters_of(spec, free, [one.scale for one in free])
    _, result = sysid.optimize(
        parameters, residual, verbose=False, max_iters=ITERATIONS, eps=STEP, output=io.StringIO()
    )
    return np.ravel(result.x)


def main(out, names):
    """A row for each set."""
    sets = read_registry().sets
    print(
        "| recordings | by the toolbox | held-out rms: nominal | toolbox | fit by hand | "
        "after the statement |\n|---|---|---|---|---|---|"
    )
    for name in names or sets:
        experiment = read_experiment(out / name)
        problem = prepare_mechanism(experiment, load_mechanism(experiment.model))
        free = list_free(problem, keys_of(sets[name], experiment))
        scored = Fit(problem, free)
        whole = fit(problem, experiment.model, free, problem.conditions)
        nominal = scored.misfits(np.zeros(len(free)), problem.conditions)
        apart = []
        for number, held in enumerate(problem.conditions):
            others = [*problem.conditions[:number], *problem.conditions[number + 1 :]]
            apart += scored.misfits(fit(problem, experiment.model, free, others), [held])
        cells = [
            ", ".join(
                f"{one.name} {value * one.scale:.3g}"
                for one, value in zip(free, whole, strict=True)
            )
        ]
        for misses in (nominal, apart):
            rows = sorted(
                zip(problem.conditions[0].signals, np.concatenate(misses, axis=1), strict=True),
                key=lambda row: row[0],
            )
            cells.append(
                ", ".join(f"{rms(row):.3g}" for signal, row in rows if "position" in signal)
            )
        by_hand = json.loads((out / f"{name}-by-hand.json").read_text(encoding="utf-8"))["held_out"]
        stated = json.loads((out / f"{name}.json").read_text(encoding="utf-8"))["held_out"]
        cells += [
            ", ".join(f"{v:.3g}" for _, v in sorted(by_hand.items())),
            ", ".join(f"{after:.3g}" for _, (_, after) in sorted(stated.items())),
        ]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

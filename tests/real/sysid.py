"""MuJoCo's own system identification on the same windows: python -m tests.real.sysid FOLDER [SET...]

FOLDER is that of `python -m tests.real`. The right parameters are freed by hand, as that toolbox asks for: dry friction and damping of
every joint, and the masses. It starts each window from the measured state, and is scored as the other fits are: one condition is held out
at a time, and the start of a held-out window is moved within its uncertainty.
"""

import json
import sys
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.data.observations import rms
from rfca_rig.diagnosis.mechanisms.problem import make_problem
from rfca_rig.mechanism.load import load_mechanism
from tests.real.__main__ import read_sets
from tests.real.hand_fit import Fit, list_free

KEYS = ["joint_friction_Nm", "joint_damping_Nm_s_per_rad", "mass_relative"]
WIDEST = 5.0  # scales of the hand fit: the bounds of a parameter
ITERATIONS = 40


def spec_of(path):
    """The model with a sensor for the position of every joint."""
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in spec.joints:
        spec.add_sensor(
            name=f"{joint.name}_read", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint.name
        )
    return spec


def parameters_of(spec, free):
    """The freed parameters as the toolbox has them; masses scale with their inertia."""
    nominal = {body.name: (body.mass, np.array(body.inertia), [geom.mass for geom in body.geoms]) for body in spec.bodies}

    def modifier(one):
        object_name = one.name.rsplit(".", 1)[0]

        def change(changed, parameter):
            value = float(np.ravel(parameter.value)[0])
            if one.key == "mass_relative":
                mass, inertia, of_geoms = nominal[object_name]
                for geom, of_geom in zip(changed.body(object_name).geoms, of_geoms, strict=True):
                    geom.mass = of_geom * (1.0 + value)
                if mass > 0.0:
                    changed.body(object_name).mass, changed.body(object_name).inertia = mass * (1.0 + value), inertia * (1.0 + value)
            elif one.key == "joint_friction_Nm":
                changed.joint(object_name).frictionloss = value
            else:
                changed.joint(object_name).damping = [value, 0.0, 0.0]

        return change

    found = sysid.ParameterDict()
    for one in free:
        least = max(one.least, -WIDEST * one.scale)
        found.add(sysid.Parameter(one.name, max(0.0, least) + 0.02 * one.scale, least, WIDEST * one.scale, modifier=modifier(one)))
    return found


def fit(problem, path, free, conditions):
    """The values of the free parameters (p,) that the toolbox finds on these conditions."""
    spec = spec_of(path)
    model = spec.compile()
    joints = len(problem.simulator.mechanism.joints)
    first = [int(np.flatnonzero(problem.simulator.columns == joint)[0]) for joint in range(joints)]
    states, controls, sensors = [], [], []
    for condition in conditions:
        for each in condition.windows:
            window = each.window
            t_s = np.arange(0.0, window.t_s[-1], model.opt.timestep)
            middle_s = t_s + 0.5 * model.opt.timestep  # the toolbox holds a command over its step
            command = np.column_stack([np.interp(middle_s, window.trace.t_s, column) for column in window.trace.command.T])
            means_s = np.array([part.mean() for part in np.split(window.t_s, window.bins[1:])])
            states.append(sysid.create_initial_state(model, window.position, window.speed))
            controls.append(sysid.TimeSeries(t_s, command))
            sensors.append(sysid.TimeSeries.from_names(means_s, window.measured[first].T, model))
    names = [f"window{k}" for k in range(len(states))]
    sequences = sysid.ModelSequences("rig", spec, names, states, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    _, result = sysid.optimize(parameters_of(spec, free), residual, verbose=False, max_iters=ITERATIONS)
    return np.asarray(result.x)


def main(out, names):
    """A row for each set."""
    sets = read_sets()
    print(
        "| recordings | by the toolbox | held-out rms of the positions | of the fit by hand | after the statement |\n|---|---|---|---|---|"
    )
    for name in names or sets:
        experiment = read_experiment(out / name)
        problem = make_problem(experiment, load_mechanism(experiment.model))
        free = list_free(problem, KEYS)
        scored = Fit(problem, free)
        values = fit(problem, experiment.model, free, problem.conditions)
        apart = []
        for number, held in enumerate(problem.conditions):
            others = [*problem.conditions[:number], *problem.conditions[number + 1 :]]
            apart += scored.misfits(fit(problem, experiment.model, free, others) / scored.scales, [held])
        rows = zip(problem.conditions[0].signals, np.concatenate(apart, axis=1), strict=True)
        errors = ", ".join(f"{rms(row):.3g}" for signal, row in rows if "position" in signal)
        by_hand = json.loads((out / f"{name}-by-hand.json").read_text(encoding="utf-8"))["held_out"]
        stated = json.loads((out / f"{name}.json").read_text(encoding="utf-8"))["held_out"]
        found = ", ".join(f"{one.name} {value:.3g}" for one, value in zip(free, values, strict=True))
        others = (", ".join(f"{v:.3g}" for v in by_hand.values()), ", ".join(f"{after:.3g}" for _, after in stated.values()))
        print(f"| {name} | {found} | {errors} | {' | '.join(others)} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])

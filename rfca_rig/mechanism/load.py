"""Loads a mechanism from an MJCF or URDF file."""

import re
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.escaping import find_unusable_sign
from rfca_rig.executors.reading import read_within_limits
from rfca_rig.mechanism.contact_law import SphereOnPlane
from rfca_rig.mechanism.free_joints import FreeFrame, expand_free_joints
from rfca_rig.mechanism.library import switch_off_timers
from rfca_rig.mechanism.named_files import find_named_files, refuse_non_finite
from rfca_rig.subprocesses import safe_path

Floats = NDArray[np.float64]

# SI unit of each kind of MuJoCo's sensors that a recording may contain
SENSOR_UNITS = {
    **dict.fromkeys(("TOUCH", "FORCE"), "N"),
    "TORQUE": "N m",
    **dict.fromkeys(("ACCELEROMETER", "FRAMELINACC"), "m/s2"),
    **dict.fromkeys(("VELOCIMETER", "FRAMELINVEL", "SUBTREELINVEL"), "m/s"),
    **dict.fromkeys(("GYRO", "FRAMEANGVEL"), "rad/s"),
    **dict.fromkeys(("FRAMEPOS", "RANGEFINDER", "SUBTREECOM"), "m"),
}
# Memory of a simulation; the default of 15 MB takes longer to allocate than a window to simulate.
ARENA_BYTES = 1 << 20

# A simulation takes the square of the joints; a humanoid has some 50.
MOST_PARTS = 2000
# MuJoCo's own step is 2 ms by default. Below and above these no model is stable or finished in a
# lifetime.
SHORTEST_STEP_S = 1e-6
LONGEST_STEP_S = 1.0
# Of a model that is compiled in some milliseconds.
PLAIN_BYTES = 100_000
# Others name further files, make copies of what is within them, or state how much memory to take.
PLAIN_ELEMENTS = frozenset(
    (
        *(
            "mujoco",
            "compiler",
            "option",
            "flag",
            "default",
            "worldbody",
            "body",
            "inertial",
            "joint",
            "freejoint",
            "geom",
            "site",
            "light",
        ),
        *(
            "actuator",
            "motor",
            "position",
            "velocity",
            "general",
            "contact",
            "pair",
            "exclude",
            "equality",
            "weld",
            "connect",
        ),
        *(
            "sensor",
            "jointpos",
            "jointvel",
            "force",
            "torque",
            "accelerometer",
            "gyro",
            "framepos",
            "touch",
        ),
    )
)
_UNOPENED = re.compile(r"Error opening file '(.*)'")
# In SI. The largest of a mechanism is the stiffness of a contact, up to 1e10 N/m; MuJoCo takes a
# state above 1e10 for a divergence.
MOST_VALUE = 1e12


@dataclass(frozen=True)
class Sensor:
    """The first value of a sensor in MuJoCo's `sensordata`, how many it has, and their SI unit."""

    first: int
    values: int
    unit: str


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A model file, compiled.

    Parameters
    ----------
    path
        Of the file.
    model
        MuJoCo's model, not to be changed; a `Plant` has a copy.
    joints, actuators, bodies
        Names; one degree of freedom per joint, in MuJoCo's order. The world is no body.
    is_slide
        (n,) whether a joint slides: its angle is a distance then, its torque a force.
    driven
        (n,) whether an actuator acts on the joint.
    sensors
        Of each sensor that a signal may hold, by name: its first value in MuJoCo's `sensordata`,
        how many it has, and their SI unit.
    has_contacts
        Whether any two bodies may touch.
    is_implicit
        Whether the model's integrator is one of MuJoCo's implicit ones, which stiff dampers need;
        Runge-Kutta if not.
    prescribed, unmeasured
        Places of joints that follow a given motion, and of joints that have no position signal.
    alike
        Names of joints, bodies or actuators of the same type, by the name of the group: they share
        values and effects.
    contacts
        Contacts that have a law of their own, in place of MuJoCo's.
    mjcf
        The model as text where `path` is a file of another format, from which it was made.
    frames
        Of the free joints, which six joints stand in for.
    couplings
        By the name of a joint that the file ties to another one: what that means for its column, in
        words.
    dropped
        Parts of the file that the model does not have, in words.
    """

    path: Path
    model: Any
    joints: tuple[str, ...]
    actuators: tuple[str, ...]
    bodies: tuple[str, ...]
    is_slide: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    sensors: Mapping[str, "Sensor"]
    has_contacts: bool
    is_implicit: bool = False
    prescribed: tuple[int, ...] = ()
    unmeasured: tuple[int, ...] = ()
    alike: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    contacts: tuple[SphereOnPlane, ...] = ()
    mjcf: str = ""
    frames: tuple[FreeFrame, ...] = ()
    couplings: Mapping[str, str] = field(default_factory=dict)
    dropped: tuple[str, ...] = ()
    _spare_data: deque[Any] = field(default_factory=deque, repr=False)

    @contextmanager
    def borrow_data(self, model: Any) -> Iterator[Any]:
        """Lends an MjData in its initial state, for a copy of this model.

        To make one takes 0.26 ms, a window of an arm 0.9 ms. Threads may borrow at the same time;
        each gets its own.
        """
        import mujoco  # noqa: PLC0415  (optional)

        # `deque.pop` is atomic, so no lock is needed; an exception instead of a check leaves no gap
        # between the two.
        try:
            data = self._spare_data.pop()
        except IndexError:
            data = mujoco.MjData(model)
        else:
            mujoco.mj_resetData(model, data)
        try:
            yield data
        finally:
            self._spare_data.append(data)

    @property
    def guided(self) -> tuple[int, ...]:
        """Places of the simulated joints that are real: none stands in for a free joint."""
        free = {name for frame in self.frames for name in frame.joints}
        return tuple(joint for joint in self.simulated if self.joints[joint] not in free)

    @property
    def simulated(self) -> tuple[int, ...]:
        """Places of the joints whose motion the model decides."""
        return tuple(joint for joint in range(len(self.joints)) if joint not in self.prescribed)

    def has_spring(self, joint: int) -> bool:
        """Whether the joint of this place has a spring of its own."""
        return bool(
            self.model.jnt_stiffness[joint] != 0.0
            or np.any(self.model.jnt_stiffnesspoly[joint] != 0.0)
        )

    @property
    def sensor_values(self) -> dict[str, tuple[int, str]]:
        """Place in `sensordata` and SI unit of each single value, by the sensor's name and,
        where it has three, the component.
        """
        values: dict[str, tuple[int, str]] = {}
        for name, sensor in self.sensors.items():
            components = ("_x", "_y", "_z") if sensor.values == 3 else ("",)
            values |= {
                f"{name}{component}": (sensor.first + k, sensor.unit)
                for k, component in enumerate(components)
            }
        return values

    def joint(self, name: str, where: str) -> int:
        """The place of a joint. Raises BadInput, which begins with `where`."""
        return _place(name, self.joints, "joint", where)

    def actuator(self, name: str, where: str) -> int:
        """The place of an actuator. Raises BadInput, which begins with `where`."""
        return _place(name, self.actuators, "actuator", where)

    def sensor_value(self, name: str, where: str) -> tuple[int, str]:
        """Place and SI unit of one value of a sensor. Raises BadInput, which begins with
        `where`.
        """
        values = self.sensor_values
        return values[tuple(values)[_place(name, tuple(values), "sensor", where)]]


def _place(name: str, names: tuple[str, ...], kind: str, where: str) -> int:
    if name not in names:
        raise BadInput(
            f"{where}: {kind} {name!r} is not in the model; it has {', '.join(names) or 'none'}"
        )
    return names.index(name)


def _ignore(text: str) -> None:
    """Discards MuJoCo's warnings."""


def load_mechanism(
    path: Path,
    beside: tuple[Path, ...] = (),
    allow_outside: bool = False,
    frames: tuple[FreeFrame, ...] = (),
) -> Mechanism:
    """Loads and checks the mechanism that a model file describes.

    Parameters
    ----------
    path
        An MJCF or URDF file. All its joints have names and are hinges, slides or, with a frame,
        free.
    beside
        Folders with files that the model may name, beside its own folder.
    allow_outside
        The model may name files anywhere.
    frames
        Of the free joints.

    Raises
    ------
    BadInput
        Where MuJoCo is not installed, the file is not there, MuJoCo refuses it, it names files
        elsewhere, it has other joints or absurd values, or it takes too much time or memory.
    """
    _prepare_mujoco()
    if not path.is_file():
        raise BadInput(f"{path}: is not there; model names an MJCF or URDF file")
    load = partial(_load, path, None if allow_outside else (path.parent, *beside), frames)
    if _is_plain(path):
        return load()
    return read_within_limits(path, load)


def make_mechanism(path: Path, mjcf: str) -> Mechanism:
    """Makes the mechanism of a text in MJCF, which describes what the file at `path` holds in
    another format.

    Raises
    ------
    BadInput
        Where MuJoCo is not installed or refuses the model; the message names `path`.
    """
    _prepare_mujoco()
    return replace(_compile(path, mjcf), mjcf=mjcf)


def _prepare_mujoco() -> None:
    """Loads MuJoCo. Raises BadInput where it is not installed."""
    if find_spec("mujoco") is None:
        raise BadInput(
            "MuJoCo is not installed, which simulates mechanisms; pip install 'rfca-rig[mechanism]'"
        )
    # To find its window library, MuJoCo's import starts an interpreter.
    with safe_path():
        import mujoco  # noqa: PLC0415  (optional)

    # By default MuJoCo writes warnings to a log file in the working directory; `roll` detects a
    # simulation that diverges.
    mujoco.set_mju_user_warning(_ignore)
    switch_off_timers()


def _is_plain(path: Path) -> bool:
    """Whether a model is short, and of elements that stand for no more than themselves: no
    limits are needed to read it.
    """
    if path.stat().st_size > PLAIN_BYTES:
        return False
    content = path.read_bytes()
    elements = {name.decode() for name in re.findall(rb"<\s*([A-Za-z_][\w.:-]*)", content)}
    return elements <= PLAIN_ELEMENTS and b"<!DOCTYPE" not in content


def _load(path: Path, allowed: tuple[Path, ...] | None, frames: tuple[FreeFrame, ...]) -> Mechanism:
    """The mechanism of a file that names files of the `allowed` folders only, or any where there
    are none.
    """
    refuse_non_finite(find_named_files(path, allowed))
    return _compile(path, frames=frames)


def _compile(path: Path, mjcf: str = "", frames: tuple[FreeFrame, ...] = ()) -> Mechanism:
    """The mechanism of a text in MJCF, or of the file at `path` where the text is empty."""
    import mujoco  # noqa: PLC0415  (optional)

    try:
        spec, dropped = read_spec(path, mjcf)
        expand_free_joints(spec, frames, str(path))
        spec.memory = ARENA_BYTES
        # MuJoCo takes a shortcut for a body whose centre of mass is at its frame, and then refuses
        # the nuisance parameters and effects that move the centre of mass.
        for body in spec.bodies[1:]:
            body.simple = False
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise BadInput(
            f"{path}: MuJoCo refuses the model: {' '.join(str(error).split())}"
        ) from None
    _refuse_unusable_names(path, spec)
    _check_values(path, model)
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): False, int(mujoco.mjtJoint.mjJNT_SLIDE): True}
    joints = tuple(model.joint(i).name for i in range(model.njnt))
    for name, kind in zip(joints, model.jnt_type, strict=True):
        if not name:
            raise BadInput(
                f"{path}: a joint has no name; give every joint one, as signals and effects need it"
            )
        if int(kind) not in kinds:
            raise BadInput(
                f"{path}: joint {name!r} is neither a hinge nor a slide; of a free joint, state "
                "the columns of its pose in [[free]]; ball joints are not supported"
            )
    if not joints:
        raise BadInput(f"{path}: the model has no joint, so nothing moves")
    actuators = tuple(model.actuator(i).name or f"actuator{i + 1}" for i in range(model.nu))
    driven = np.zeros(model.njnt, dtype=bool)
    for kind, (target, _) in zip(model.actuator_trntype, model.actuator_trnid, strict=True):
        if kind == mujoco.mjtTrn.mjTRN_JOINT:
            driven[target] = True
    return Mechanism(
        path=path,
        model=model,
        joints=joints,
        actuators=actuators,
        bodies=tuple(model.body(i).name or f"body{i}" for i in range(1, model.nbody)),
        is_slide=np.array([kinds[int(kind)] for kind in model.jnt_type]),
        driven=driven,
        sensors=_list_sensors(model),
        has_contacts=bool(
            model.npair > 0 or np.any(model.geom_contype & model.geom_conaffinity[:, None])
        ),
        is_implicit=model.opt.integrator
        in (mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST),
        frames=frames,
        couplings=_list_couplings(model),
        dropped=dropped,
    )


def _list_couplings(model: Any) -> dict[str, str]:
    """Of each joint that an equality ties to another one, as MuJoCo makes of a URDF's mimic: how to
    state its column.
    """
    import mujoco  # noqa: PLC0415  (optional)

    couplings = {}
    for number in range(model.neq):
        tied = int(model.eq_obj1id[number])
        leading = int(model.eq_obj2id[number])
        is_of_joints = model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT
        if not is_of_joints or not model.eq_active0[number] or leading < 0:
            continue
        name = model.joint(leading).name
        constant, slope, *higher = (float(value) for value in model.eq_data[number, :5])
        if constant == 0.0 and abs(slope) == 1.0 and not any(higher):
            state = f"state the column of joint {name!r} for it, with sign = {slope:.0f}"
        else:
            state = f"compute its column from that of joint {name!r}, and state it"
        couplings[model.joint(tied).name] = f"an equality ties it to joint {name!r}: {state}"
    return couplings


def _check_values(path: Path, model: Any) -> None:
    """Raises BadInput for a model that cannot be computed with: too large, or with values that
    no mechanism has.
    """
    for what, count in (
        ("joints", model.nv),
        ("bodies", model.nbody),
        ("actuators", model.nu),
        ("sensors", model.nsensor),
    ):
        if count > MOST_PARTS:
            raise BadInput(
                f"{path}: has {count} {what}, where {MOST_PARTS} are the most; remove "
                "what the recordings do not show"
            )
    if not SHORTEST_STEP_S <= model.opt.timestep <= LONGEST_STEP_S:
        allowed = f"{SHORTEST_STEP_S:g} to {LONGEST_STEP_S:g} s"
        raise BadInput(
            f"{path}: option timestep is {model.opt.timestep:g} s; give a time step of {allowed}"
        )
    for name, numbers in [*_float_arrays("", model), *_float_arrays("option ", model.opt)]:
        # Also true for NaN.
        absurd = numbers[~(np.abs(numbers) <= MOST_VALUE)]
        if absurd.size:
            raise BadInput(
                f"{path}: {name} holds {absurd[0]:g}; values are finite, and "
                f"{MOST_VALUE:g} or less in size"
            )


def _float_arrays(prefix: str, structure: Any) -> Iterator[tuple[str, Floats]]:
    """Every array of floating-point numbers that one of MuJoCo's structures holds, by its name."""
    for name in dir(structure):
        value = getattr(structure, name)
        if isinstance(value, float):
            yield f"{prefix}{name}", np.array([value])
        elif isinstance(value, np.ndarray) and value.dtype.kind == "f":
            yield f"{prefix}{name}", np.ravel(value)


def read_spec(path: Path, mjcf: str = "") -> tuple[Any, tuple[str, ...]]:
    """Reads the file, or the text in MJCF if there is any.

    URDF has no actuators: every joint gets a motor of its name, whose command is its torque or
    force. Visual meshes that are missing are dropped: nothing depends on them where a body has its
    mass from an inertial.

    Returns
    -------
    spec
        MuJoCo's specification, ready to be compiled.
    dropped
        What was dropped, in words.

    Raises
    ------
    BadInput
        Where a mesh is not there that contacts or masses depend on.
    ValueError
        Where MuJoCo refuses the file.
    """
    import mujoco  # noqa: PLC0415  (optional)

    if mjcf:
        return mujoco.MjSpec.from_string(mjcf), ()
    # MuJoCo composes the paths of included and attached parts from that of the model.
    spec = mujoco.MjSpec.from_file(str(path.resolve()))
    dropped = _drop_missing_meshes(path, spec)
    if path.suffix.lower() == ".urdf":
        for joint in spec.joints:
            if joint.name and joint.type in (
                mujoco.mjtJoint.mjJNT_HINGE,
                mujoco.mjtJoint.mjJNT_SLIDE,
            ):
                spec.add_actuator(
                    name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
                )
    return spec, dropped


def _drop_missing_meshes(path: Path, spec: Any) -> tuple[str, ...]:
    """Drops the visual meshes that MuJoCo does not find, and says which. Only MuJoCo knows where it
    looks: included and attached parts have folders of their own.
    """
    dropped = []
    for _ in range(len(spec.meshes)):
        try:
            spec.compile()
        except ValueError as error:
            unopened = _UNOPENED.search(str(error))
            # Any other fault is put into words by the caller, which compiles the model again.
            if unopened is None:
                break
            missing = [mesh for mesh in spec.meshes if _is_of(mesh, unopened[1])]
            if not missing:
                break
            _drop_mesh(path, spec, missing[0])
            dropped.append(f"the visual mesh {missing[0].file}, which is not there")
        else:
            break
    return tuple(dropped)


def _is_of(mesh: Any, file: str) -> bool:
    """Whether a mesh is read from this file, which is named with its folder."""
    return bool(mesh.file) and Path(mesh.file).name == Path(file).name


def _drop_mesh(path: Path, spec: Any, mesh: Any) -> None:
    """Drops a mesh and its geometry. Raises BadInput where contacts or masses depend on it."""
    for geom in [geom for geom in spec.geoms if geom.meshname == mesh.name]:
        use = ""
        if geom.contype or geom.conaffinity:
            use = "contacts depend"
        elif not geom.parent.explicitinertial:
            use = "the mass depends"
        if use:
            raise BadInput(
                f"{path}: mesh {mesh.file} of body {geom.parent.name!r} is not there, and {use} on "
                "it; put it there, or remove that geometry from the model"
            )
        spec.delete(geom)
    spec.delete(mesh)


def _refuse_unusable_names(path: Path, spec: Any) -> None:
    """Raises BadInput for a name that looks like a part of the text around it, in messages,
    files and pages.
    """
    named = {
        "joint": spec.joints,
        "actuator": spec.actuators,
        "body": spec.bodies,
        "sensor": spec.sensors,
        "geom": spec.geoms,
    }
    for kind, elements in named.items():
        for element in elements:
            sign = find_unusable_sign(element.name)
            if sign is not None:
                raise BadInput(
                    f"{path}: the name of {kind} {element.name!r} has {sign}; rename it "
                    "in the model"
                )


def _list_sensors(model: Any) -> dict[str, Sensor]:
    """Sensors that have a name and a unit, by name; others cannot be a signal."""
    import mujoco  # noqa: PLC0415  (optional)

    kinds = {
        int(getattr(mujoco.mjtSensor, f"mjSENS_{kind}")): unit
        for kind, unit in SENSOR_UNITS.items()
    }
    sensors = [(model.sensor(i).name, int(model.sensor_type[i]), i) for i in range(model.nsensor)]
    return {
        name: Sensor(int(model.sensor_adr[i]), int(model.sensor_dim[i]), kinds[kind])
        for name, kind, i in sensors
        if name and kind in kinds
    }

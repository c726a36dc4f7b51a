"""The flexible leg as an MJCF file: on a rack that slides to its height, with a prescribed shaft and hinges with springs.

Plane of motion y-z, angles positive downwards from +y. The force sensor stands between world and rack, `below_shaft` under the shaft, with
its z axis down.
"""

from rfca_rig.model.hinge_springs import polynomial_springs
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg, RigModel

RACK, SHAFT, FLOOR, SENSOR = "rack", "shaft", "floor", "mount"
RACK_KG = 1e-6  # MuJoCo wants a mass; its weight in the sensor is 1e-5 N


def hinge_names(leg: Leg) -> tuple[str, ...]:
    """The hinges behind the shaft."""
    return tuple(f"hinge{i + 1}" for i in range(1, len(leg.link_lengths_m)))


def link_names(leg: Leg) -> tuple[str, ...]:
    """The links' bodies."""
    return tuple(f"link{i + 1}" for i in range(len(leg.link_lengths_m)))


def end_names(leg: Leg) -> tuple[str, ...]:
    """The spheres at the links' ends."""
    return tuple(f"end{i + 1}" for i in range(len(leg.link_lengths_m)))


def write_leg_mjcf(rig: RigModel) -> str:
    """The model in MJCF. The rack's joint is the height of the shaft above the floor, 0 on it."""
    links = ""
    # From the last link inwards, as each body contains the text of those beyond it.
    for i in reversed(range(len(rig.leg.link_lengths_m))):
        links = _link(rig, i, links)
    pairs = "".join(_pair(rig, name) for name in end_names(rig.leg))
    return f"""<mujoco model="flexible leg">
 <compiler angle="radian"/>
 <option gravity="0 0 {-GRAVITY_M_S2!r}" integrator="implicitfast" timestep="0.0001" cone="elliptic"/>
 <worldbody>
  <geom name="{FLOOR}" type="plane" size="2 2 1" contype="0" conaffinity="0"/>
  <body name="{RACK}"><joint name="{RACK}" type="slide" axis="0 0 1"/>
   <inertial pos="0 0 0" mass="{RACK_KG}" diaginertia="1e-9 1e-9 1e-9"/>
   <site name="{SENSOR}" pos="0 0 {-rig.sensor.below_shaft_m!r}" quat="0 1 0 0"/>
{links}  </body>
 </worldbody>
 <contact>{pairs}
 </contact>
 <sensor><force name="{SENSOR}_force" site="{SENSOR}"/><torque name="{SENSOR}_torque" site="{SENSOR}"/></sensor>
</mujoco>
"""


def _link(rig: RigModel, i: int, further: str) -> str:
    """Link i, a thin uniform rod along its own y. Its inertia about y, which planar motion does not involve, is a thousandth."""
    leg, length, mass = rig.leg, rig.leg.link_lengths_m[i], rig.leg.link_masses_kg[i]
    inertia = mass * length**2 / 12.0
    name = SHAFT if i == 0 else hinge_names(leg)[i - 1]
    spring, at = "", leg.link_lengths_m[i - 1] if i else 0.0
    if i:
        first, second, third = polynomial_springs(leg, "a mechanism of MuJoCo")
        stiffness = f"{first!r} {second:g} {third!r}"
        spring = f' stiffness="{stiffness}" damping="{leg.hinge_damping_Nm_s_per_rad!r}"'
        if leg.rest_angles_rad:
            spring += f' springref="{leg.rest_angles_rad[i - 1]!r}"'
    return f"""   <body name="{link_names(leg)[i]}" pos="0 {at!r} 0"><joint name="{name}" axis="-1 0 0"{spring}/>
    <inertial pos="0 {length / 2.0!r} 0" mass="{mass!r}" diaginertia="{inertia!r} {1e-3 * inertia!r} {inertia!r}"/>
    <geom name="{end_names(leg)[i]}" size="{leg.link_radius_m!r}" pos="0 {length!r} 0" mass="0" contype="0" conaffinity="0"/>
{further}   </body>
"""


def _pair(rig: RigModel, name: str) -> str:
    """MuJoCo's own contact, for viewers: about as stiff under the leg's weight; a diagnosis replaces it by the floor's law."""
    mu = rig.ground.friction_coefficient
    return f"""
  <pair geom1="{FLOOR}" geom2="{name}" condim="3" friction="{mu!r} {mu!r} 0 0 0"/>"""

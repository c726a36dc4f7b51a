"""Parameters of the exam's simulator for one stroke: everything that a hidden effect can change.
SI units, radians.
"""

from dataclasses import dataclass

GRAVITY_M_S2 = 9.81
LINKS = 7
HINGES = LINKS - 1


def for_each_hinge(value: float, count: int = HINGES) -> tuple[float, ...]:
    """The same value for each hinge, as a tuple of `count`."""
    return (value,) * count


@dataclass(frozen=True)
class Links:
    """Rods from the shaft outwards: lengths and masses (7,); a point mass sits on the far end of
    the last.
    """

    length_m: tuple[float, ...]
    mass_kg: tuple[float, ...]
    end_radius_m: float
    tip_mass_kg: float = 0.0
    drag_N_s2_per_m3: float = 0.0
    drag_power: float = 2.0


@dataclass(frozen=True)
class Hinges:
    """Laws that resist the turn phi of each hinge, from the shaft outwards; every field is (6,),
    zero where the law is absent.

    The spring torque is k0 x (1 + k2 x^2) with x = phi - preset, less the play `gap` on either
    side. `asymmetry` makes it stiffer by that share for x > 0 and softer for x < 0. Further laws:

    - damping, linear and quadratic in the rate;
    - a stop at `stop_rad`;
    - dry friction of the pin, which is full after `pin_creep` of turn;
    - a rate-independent hysteresis `loop`, with the torque and the angle at which it saturates;
    - an `arm`: a spring in series with a dashpot, by its stiffness and time constant;
    - detents, which pull the hinge to evenly spaced angles;
    - a tendon along the leg, which pulls at every hinge in proportion to the sum of all hinge
      angles.
    """

    k0_Nm_per_rad: tuple[float, ...]
    k2_per_rad2: tuple[float, ...]
    damping_Nm_s_per_rad: tuple[float, ...]
    gap_rad: tuple[float, ...] = for_each_hinge(0.0)
    preset_rad: tuple[float, ...] = for_each_hinge(0.0)
    asymmetry: tuple[float, ...] = for_each_hinge(0.0)
    quadratic_Nm_s2_per_rad2: tuple[float, ...] = for_each_hinge(0.0)
    # Beyond any possible angle.
    stop_rad: tuple[float, ...] = for_each_hinge(10.0)
    stop_Nm_per_rad: tuple[float, ...] = for_each_hinge(0.0)
    pin_Nm: tuple[float, ...] = for_each_hinge(0.0)
    loop_Nm: tuple[float, ...] = for_each_hinge(0.0)
    loop_rad: tuple[float, ...] = for_each_hinge(1.0)
    arm_Nm_per_rad: tuple[float, ...] = for_each_hinge(0.0)
    arm_s: tuple[float, ...] = for_each_hinge(1.0)
    pin_creep_rad: tuple[float, ...] = for_each_hinge(1e-3)
    detent_Nm: tuple[float, ...] = for_each_hinge(0.0)
    detents_per_rad: tuple[float, ...] = for_each_hinge(1.0)
    tendon_Nm_per_rad: tuple[float, ...] = for_each_hinge(0.0)


@dataclass(frozen=True)
class Floor:
    """The floor under the circles at the link ends.

    - Normal force: stiffness depth^exponent (1 + damping * rate). Damping acts during separation
      too if `two_sided`.
    - Friction: at most mu N, reached over `presliding`, and a viscous share beside it. For slip to
      -y, mu is multiplied by `mu_backward_share`. `stribeck_rise` is how much more it is at rest,
      relative to mu; the rise decays over the speed `stribeck_m_s`.
    - Lever: `lever_share` of the depth is taken off friction's lever at a typical depth;
      `lever_power` is its power of the depth.
    - Shape: a `slope`, and a bump of Gaussian shape.
    - Attraction: `adhesion` pulls while touching, fully from about `adhesion_hold` of depth on.
      `magnet` pulls the tip from afar, half as strong at 0.41 `magnet_reach`, a quarter at
      `magnet_reach`.
    - Patch: from `patch_at` on, over `patch_width`, friction and stiffness are multiplied by these
      factors.
    - Shaking: up and down by `shake` at `shake_Hz`.
    """

    stiffness: float
    damping_s_per_m: float
    mu: float
    exponent: float = 1.5
    two_sided: bool = True
    presliding_m: float = 1e-4
    drag_N_s_per_m: float = 2.0
    lever_share: float = 0.0
    lever_power: float = 1.0
    stribeck_rise: float = 0.0
    stribeck_m_s: float = 1.0
    stribeck_power: float = 1.0
    mu_backward_share: float = 1.0
    slope: float = 0.0
    bump_m: float = 0.0
    bump_at_m: float = 0.0
    bump_width_m: float = 1.0
    adhesion_N: float = 0.0
    adhesion_hold_m: float = 2e-4
    magnet_N: float = 0.0
    magnet_reach_m: float = 1.0
    patch_at_m: float = 0.0
    patch_width_m: float = 0.0
    patch_mu_factor: float = 1.0
    patch_stiffness_factor: float = 1.0
    shake_m: float = 0.0
    shake_Hz: float = 1.0


@dataclass(frozen=True)
class DriveModel:
    """The drive of the shaft. It follows its command exactly unless these fields say otherwise.

    `kp` > 0 puts a rotor under PI control of its speed, with a torque within `limit`; beside it the
    motor has cogging. `shaft_Nm_per_rad` > 0 is a torsion spring between motor and leg, with play
    `shaft_gap` on either side, whose ends lose energy. `cable_Nm` drags against the turn, and a
    hose turns the leg back to its start like a spring. `ramp_s` is how long the command takes to
    reach its speed, and `late_s` how long it takes to reach the drive.
    """

    start_angle_rad: float
    ramp_s: float
    kp_Nm_s_per_rad: float = 0.0
    ki_Nm_per_rad: float = 0.0
    rotor_kg_m2: float = 0.006
    shaft_Nm_per_rad: float = 0.0
    shaft_Nm_s_per_rad: float = 0.0
    shaft_gap_rad: float = 0.0
    shaft_loss_s_per_rad: float = 0.0
    ripple_share: float = 0.0
    ripple_cycles: float = 1.0
    ripple_phase_rad: float = 0.0
    # Practically no limit.
    limit_Nm: float = 1e9
    cogging_Nm: float = 0.0
    cogging_cycles: float = 1.0
    cable_Nm: float = 0.0
    hose_Nm_per_rad: float = 0.0
    late_s: float = 0.0


@dataclass(frozen=True)
class Mount:
    """Position of the shaft. Gravity leans towards +y by `lean_rad`.

    `frame_kg` > 0 lets the shaft yield along a line that leans from down towards +y; the sensor
    feels a share of this mass.
    """

    height_m: float
    below_shaft_m: float
    frame_kg: float = 0.0
    frame_N_per_m: float = 0.0
    frame_N_s_per_m: float = 0.0
    frame_lean_rad: float = 0.0
    frame_felt_share: float = 0.0
    lean_rad: float = 0.0


@dataclass(frozen=True)
class Sensing:
    """Faults of the force sensor. They act in this order: cogging, gain and curvature, play, creep,
    crosstalk, ringing, lag, clock, drift, hum, clipping, dead band and resolution.

    `curvature_per_N` makes fz read fz (1 + curvature |fz|); `cogging` is a ripple of fz over the
    shaft angle; `play_N` is half the width of a loop of fz, as of a loose mount; fz creeps on by
    `creep_share` of itself within about `creep_s`; `hum` comes from the mains; `clip_N` is where fz
    saturates, and what is smaller than `dead_N` reads zero. `y_frequency_ratio` is how much faster
    it rings along y.
    """

    lag_s: float = 0.0
    clock_offset_s: float = 0.0
    fz_per_fy: float = 0.0
    drift_N_per_s: float = 0.0
    gain: float = 1.0
    curvature_per_N: float = 0.0
    clip_N: float = 1e9
    cogging_N: float = 0.0
    cogging_cycles: float = 1.0
    ringing_Hz: float = 0.0
    ringing_ratio: float = 0.1
    y_frequency_ratio: float = 1.0
    clock_rate: float = 0.0
    fy_per_fz: float = 0.0
    tx_per_fy_m: float = 0.0
    tx_per_fz_m: float = 0.0
    play_N: float = 0.0
    creep_share: float = 0.0
    creep_s: float = 1.0
    hum_N: float = 0.0
    hum_Hz: float = 50.0
    dead_N: float = 0.0
    digit_N: float = 0.0


@dataclass(frozen=True)
class World:
    """The true rig during one stroke; `strokes_before` is how many strokes of the campaign were
    made before it.
    """

    links: Links
    hinges: Hinges
    floor: Floor
    drive: DriveModel
    mount: Mount
    sensing: Sensing = Sensing()
    strokes_before: int = 0

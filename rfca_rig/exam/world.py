"""The physics of one stroke as the exam's simulator knows it: everything that a concealed effect can change. SI units, radians."""

from dataclasses import dataclass

GRAVITY_M_S2 = 9.81
LINKS = 7
HINGES = LINKS - 1


def everywhere(value: float, count: int = HINGES) -> tuple[float, ...]:
    """The same value at each hinge, or at each of `count` places."""
    return (value,) * count


@dataclass(frozen=True)
class Links:
    """Rods from the shaft outwards: lengths and masses (7,); a point mass rides on the far end of the last."""

    length_m: tuple[float, ...]
    mass_kg: tuple[float, ...]
    end_radius_m: float
    tip_mass_kg: float = 0.0
    drag_N_s2_per_m3: float = 0.0
    drag_power: float = 2.0


@dataclass(frozen=True)
class Hinges:
    """What resists the turn phi of each hinge, from the shaft outwards; every field (6,), zero where there is none of it.

    The spring k0 x (1 + k2 x^2) engages at x = phi - preset, less the play `gap` on either side; `asymmetry` makes it harder by
    that share for x > 0 and softer for x < 0. Beside it: damping linear and quadratic in the rate, a stop, dry friction of the pin,
    which is full after `pin_creep` of turn, a rate-independent loop (torque and angle at which it saturates), a spring in series with a
    dashpot. Detents pull the hinge to even angles. A tendon along the leg pulls at every hinge in proportion to the whole bend.
    """

    k0_Nm_per_rad: tuple[float, ...]
    k2_per_rad2: tuple[float, ...]
    damping_Nm_s_per_rad: tuple[float, ...]
    gap_rad: tuple[float, ...] = everywhere(0.0)
    preset_rad: tuple[float, ...] = everywhere(0.0)
    asymmetry: tuple[float, ...] = everywhere(0.0)
    quadratic_Nm_s2_per_rad2: tuple[float, ...] = everywhere(0.0)
    stop_rad: tuple[float, ...] = everywhere(10.0)
    stop_Nm_per_rad: tuple[float, ...] = everywhere(0.0)
    pin_Nm: tuple[float, ...] = everywhere(0.0)
    loop_Nm: tuple[float, ...] = everywhere(0.0)
    loop_rad: tuple[float, ...] = everywhere(1.0)
    arm_Nm_per_rad: tuple[float, ...] = everywhere(0.0)
    arm_s: tuple[float, ...] = everywhere(1.0)
    pin_creep_rad: tuple[float, ...] = everywhere(1e-3)
    detent_Nm: tuple[float, ...] = everywhere(0.0)
    detents_per_rad: tuple[float, ...] = everywhere(1.0)
    tendon_Nm_per_rad: tuple[float, ...] = everywhere(0.0)


@dataclass(frozen=True)
class Floor:
    """The floor under the circles at the link ends.

    Normal force stiffness depth^exponent (1 + damping * rate), the rate of separation counts too unless not `two_sided`.
    Friction mu N at the limit, reached over `presliding`; a viscous share beside it. `mu_backward_share` times mu for slip to -y.
    The floor rises by `slope`, and by a bump of Gaussian shape. `adhesion` pulls while touching, fully from about
    `adhesion_hold` of depth on; `magnet` pulls the tip from afar,
    half as strong at `magnet_reach / 2.41`, a quarter at `magnet_reach`. `lever_share` of the depth is taken off the lever of friction at
    a typical depth; `lever_power` says how that grows with the depth. On a patch from `patch_at` on, friction and stiffness are other by
    these factors. The floor shakes up and down by `shake` at `shake_Hz`.
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
class DriveOf:
    """What turns the leg. Stiff unless said otherwise; `kp` > 0 puts a rotor under PI control of its speed, whose torque
    stays within `limit`; beside it the motor cogs.

    `shaft_Nm_per_rad` > 0 is a twist between motor and leg, with play `shaft_gap` on either side, whose ends lose energy. `cable_Nm` drags
    against the turn, and a hose turns the leg back to its start like a spring.
    `ramp_s` is how long the command takes to reach its speed, and `late_s` how long it takes to reach the drive.
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
    limit_Nm: float = 1e9
    cogging_Nm: float = 0.0
    cogging_cycles: float = 1.0
    cable_Nm: float = 0.0
    hose_Nm_per_rad: float = 0.0
    late_s: float = 0.0


@dataclass(frozen=True)
class Mount:
    """Where the shaft is. Gravity leans towards +y by `lean_rad`.

    `frame_kg` > 0 lets it yield along a line that leans from down towards +y; the sensor feels a share of this mass.
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
    """What the sensor makes of the force, in this order: cogging, gain and curvature, play, creep, crosstalk, ringing, lag, clock, drift,
    hum, clipping, dead band and last digit.

    `curvature_per_N` makes fz read fz (1 + curvature |fz|); `cogging` is a ripple of fz over the shaft angle; `play_N` is half the width
    of a loop of fz, as of a loose mount; fz creeps on by `creep_share` of itself within about `creep_s`; `hum` comes from the mains;
    `clip_N` is where fz saturates, and what is smaller than `dead_N` reads zero. `y_frequency_ratio` is how much faster it rings along y.
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
    """One rig, as it really is during one stroke; `strokes_before` it in the campaign."""

    links: Links
    hinges: Hinges
    floor: Floor
    drive: DriveOf
    mount: Mount
    sensing: Sensing = Sensing()
    strokes_before: int = 0

"""Effects in the hinges of a leg."""

from dataclasses import replace

from rfca_rig.model.effect import Declaration

HINGE_COULOMB_FRICTION = Declaration(
    id="hinge_coulomb_friction",
    where="hinges",
    left_out="dry friction of the pins",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; the paper's eqs. (18)-(19) applied to a hinge, its stuck state damped",
    families=("hinge_dissipation", "spring_memory"),
)

HINGE_VISCOUS_DAMPING = Declaration(
    id="hinge_viscous_damping",
    where="hinges",
    left_out="more damping than the nominal value",
    law="T = c phi', on top of the nominal damping",
    source="Kelvin-Voigt element",
    # A pendulum's joints are hinges without a spring.
    families=("hinge_dissipation", "joint_dissipation", "joint_loss_with_speed"),
    same_as="hinge_damping",
)

HINGE_QUADRATIC_DAMPING = Declaration(
    id="hinge_quadratic_damping",
    where="hinges",
    left_out="damping that grows with the square of the speed",
    law="T = c phi' |phi'|, on top of the nominal damping",
    source=(
        "turbulent loss of a fluid that the hinge displaces: Bernoulli's pressure drop, "
        "proportional to the square of the flow"
    ),
    families=("hinge_dissipation",),
)

SPRING_HYSTERESIS = Declaration(
    id="spring_hysteresis",
    where="hinges",
    left_out="rate-independent loop of the spring (Bouc-Wen)",
    law="T = s k0 phi_s z, z' = (1 - |z|^n sgn(z phi')) phi' / phi_s, n = 1 unless given",
    source="Bouc 1967, Wen 1976",
    families=("hinge_dissipation", "spring_memory"),
)

SPRING_RELAXATION = Declaration(
    id="spring_relaxation",
    where="hinges",
    left_out="viscoelastic arm beside the spring (Maxwell)",
    law="T = s k0 (phi - x), x' = (phi - x) / tau",
    source="Maxwell element",
    families=("hinge_dissipation", "spring_memory"),
)

DAMAGED_HINGE = Declaration(
    id="damaged_hinge",
    where="one hinge",
    left_out="one hinge softer than its fellows",
    law="k0 of that hinge times a factor",
    source="-",
    families=("hinge_stiffness",),
    bench_test="bench pull",
)

HINGE_BACKLASH = Declaration(
    id="hinge_backlash",
    where="hinges",
    left_out="play before the spring engages",
    law="T = spring(sgn(phi) max(|phi| - gap, 0))",
    source="dead zone in series with the spring",
    families=("hinge_stiffness",),
    bench_test="bench pull",
    needs_k2=True,
)

HINGE_STOP = Declaration(
    id="hinge_stop",
    where="hinges",
    left_out="shell segments meet, stiff beyond an angle",
    law="T = k b (beyond / b)^n sgn(phi), beyond = |phi| - angle, b = 0.05 rad, n = 1 unless given",
    source="one-sided spring",
    families=("hinge_stiffness",),
    bench_test="bench pull",
)

HINGE_REST_ANGLE = Declaration(
    id="hinge_rest_angle",
    where="hinges",
    left_out="the hinges rest at an angle: a permanent set",
    law="phi counts from this angle in the spring's torque, in all hinges",
    source="eq. (12), phi_i0",
    families=("hinge_stiffness",),
    single="joint",
    bench_test="unloaded leg",
)

HINGE_REST_ANGLE_OF_ONE = replace(
    HINGE_REST_ANGLE.of_one(),
    where="one hinge",
    left_out="one hinge rests at an angle: a permanent set",
    law="phi counts from this angle in the spring's torque, in one hinge",
)

STIFFNESS_HARDENING = Declaration(
    id="stiffness_hardening",
    where="hinges",
    left_out="torque curve harder or softer than nominal at large angles",
    law="T = k0 phi (1 + k2 phi^2) with this k2 in place of the nominal one",
    source="cubic hardening",
    families=("hinge_stiffness",),
    bench_test="bench pull",
    needs_k2=True,
)

STIFFNESS_FADING = Declaration(
    id="stiffness_fading",
    where="hinges",
    left_out="the hinges lose stiffness from stroke to stroke",
    law="k0 (1 - loss)^lg(1 + n) in all hinges, n strokes before in the campaign",
    source="cyclic softening in proportion to the logarithm of the cycles",
    families=("hinge_stiffness",),
    needs_order=True,
)

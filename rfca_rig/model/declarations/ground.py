"""Effects of the floor and of contacts."""

from rfca_rig.model.effect import Declaration

GROUND_COMPLIANCE = Declaration(
    id="ground_compliance",
    where="ground",
    left_out="soft floor",
    law=(
        "N = F (depth / b)^p in series with the nominal contact, F = 20 N, b = (F / "
        "k)^(2/3), p = 1.5 unless given"
    ),
    source=(
        "Hertz contacts in series; an exponent of 1 for a bed of springs (Winkler), of 2 for "
        "a cone (Sneddon 1965)"
    ),
    families=("floor_yields",),
    same_as="contact_stiffness",
)

GROUND_EXPONENT = Declaration(
    id="ground_exponent",
    where="ground",
    left_out="contact of another shape, as along a line",
    law="N = F (depth / b)^p (1 + c rate), F = 20 N, b where the nominal contact presses with F",
    source=(
        "exponent 1 for a line contact (Johnson 1985, ch. 4) or a bed of springs, 1.5 after "
        "Hertz, 2 for a cone (Sneddon 1965)"
    ),
    families=("floor_yields",),
)

GROUND_STRIBECK = Declaration(
    id="ground_stribeck",
    where="ground",
    left_out="friction that falls with sliding speed",
    law="mu (1 + rise exp(-(|v| / v_s)^d)), d = 1 unless given",
    source=(
        "Stribeck 1902; exponent as in Bo and Pavelescu 1982 (0.5 to 1) and "
        "Armstrong-Helouvry 1991 (2)"
    ),
    families=("floor_friction",),
)

GROUND_ADHESION = Declaration(
    id="ground_adhesion",
    where="ground",
    left_out="floor holds the leg back at lift-off",
    law="N - F (1 - exp(-depth / reach)) while touching",
    source=(
        "Derjaguin, Muller and Toporov 1975 (constant); Johnson, Kendall and Roberts 1971 "
        "(grows with the contact)"
    ),
    families=("floor_holds",),
)

GROUND_TILT = Declaration(
    id="ground_tilt",
    where="ground",
    left_out="floor not level",
    law="floor at -height + slope y",
    source="-",
    families=("floor_geometry",),
    bench_test="rest pose",
)

GROUND_BUMP = Declaration(
    id="ground_bump",
    where="ground",
    left_out="a bump or hollow of the floor",
    law=(
        "floor at -height + B exp(-((y - y_0) / b)^2), y from below the shaft to where the "
        "leg starts; depth along its normal"
    ),
    source="signed distance to a smooth profile: the nearest point carries the contact",
    families=("floor_geometry",),
    bench_test="straightedge",
)

HEIGHT_OFFSET = Declaration(
    id="height_offset",
    where="rig",
    left_out="rack height wrong",
    law="true height = stated height + offset",
    source="-",
    families=("floor_geometry",),
    same_as="height",
    bench_test="gauge block",
)

CONTACT_STIFFNESS = Declaration(
    id="contact_stiffness",
    where="ground",
    left_out="the contacts are softer or stiffer",
    law="the model's value times the factor",
    source="MuJoCo, solver parameters",
    families=("contact_compliance",),
    same_as="contact_stiffness_relative",
)

CONTACT_DAMPING = Declaration(
    id="contact_damping",
    where="ground",
    left_out="the contacts lose more or less energy",
    law="the model's value times the factor",
    source="MuJoCo, solver parameters",
    families=("contact_compliance",),
    same_as="contact_damping_relative",
)

CONTACT_FRICTION = Declaration(
    id="contact_friction",
    where="ground",
    left_out="friction of the contacts differs",
    law="the model's value times the factor",
    source="MuJoCo, solver parameters",
    families=("floor_friction",),
    same_as="contact_friction_relative",
)

CONTACT_POWER = Declaration(
    id="contact_power",
    where="ground",
    left_out="the force of the contacts grows with another power of their depth",
    law=("N (d / d_0)^p, d_0 the depth that bears the weight; p = -0.5 for a line, 0 for a point"),
    source="Johnson, Contact Mechanics, 1985, ch. 4",
    families=("contact_compliance",),
)

"""The leaf spring of the leg, a flat strip, and the materials that the paper compares for it (Table
I, stored in materials.toml).

Discretises a leg into another number of links; total length, mass distribution and strip are kept.

The strip bends everywhere between the shells; a hinge spring represents the bending of one part of
it, its cell, from the middle of one link to the middle of the next. Where the moment in a cell of
length p is M, the strip there turns by p kappa(M), and that is the hinge's angle phi. So torque
over angle of a hinge is the strip's moment over curvature, M(kappa) = T(p kappa), and a strip cut
into cells of length p / m has

    T'(phi) = M(m phi / p) = T(m phi):     k0' = m k0,   k2' = m^2 k2,   c' = m c

and a measured curve has its angles divided by m at the same torques. m such springs in series, each
turning by phi / m, carry the torque of one that turns by phi: the series of springs. With ever more
links the leg becomes a beam of bending stiffness k0 p with rigid ends, and differs from it by terms
in p^2.

The length over which the strip bends follows from the leg itself: its hinges' cells, those at the
ends reaching as far outwards as inwards. That length keeps its place in the leg, and is divided
equally among the new hinges. Parameters of effects per hinge do not change. In the other reading
each pin bends a free length of its own, and k0 stays the same; the paper does not state which is
true.
"""

import tomllib
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import Leg

Floats = NDArray[np.float64]

MOST_LINKS = 60


@dataclass(frozen=True)
class Material:
    """One column of Table I, in SI units."""

    name: str
    density_kg_m3: float
    youngs_modulus_Pa: float
    poisson_ratio: float
    bending_strength_Pa: float

    @property
    def specific_modulus_m2_s2(self) -> float:
        return self.youngs_modulus_Pa / self.density_kg_m3

    @property
    def breaking_strain(self) -> float:
        """Strain at the surface when the bending strength is reached."""
        return self.bending_strength_Pa / self.youngs_modulus_Pa


@dataclass(frozen=True)
class Strip:
    """`count` equal flat strips side by side that bend across their thickness. The stiffness is
    that of all of them.
    """

    material: Material
    width_m: float
    thickness_m: float
    length_m: float
    count: int

    @property
    def second_moment_m4(self) -> float:
        """Of all strips: count * width * thickness^3 / 12."""
        return self.count * self.width_m * self.thickness_m**3 / 12.0

    @property
    def bending_stiffness_Nm2(self) -> float:
        """E I of all strips, each free to curve across its width as a narrow beam does; this is
        the paper's E I.
        """
        return self.material.youngs_modulus_Pa * self.second_moment_m4

    @property
    def flattened_bending_stiffness_Nm2(self) -> float:
        """E I / (1 - nu^2): if shells keep the strips flat across their width, as a plate."""
        return self.bending_stiffness_Nm2 / (1.0 - self.material.poisson_ratio**2)

    @property
    def mass_kg(self) -> float:
        """Of all strips."""
        return (
            self.material.density_kg_m3
            * self.count
            * self.width_m
            * self.thickness_m
            * self.length_m
        )

    def strain_at(self, curvature_per_m: float) -> float:
        """Strain at the surface of a strip bent to this curvature."""
        return 0.5 * self.thickness_m * abs(curvature_per_m)

    def stress_at_Pa(self, curvature_per_m: float) -> float:
        """Stress at the surface, linear up to the strength."""
        return self.material.youngs_modulus_Pa * self.strain_at(curvature_per_m)

    @property
    def breaking_curvature_per_m(self) -> float:
        """Curvature at which the surface reaches the bending strength."""
        return 2.0 * self.material.breaking_strain / self.thickness_m

    @property
    def breaking_moment_Nm(self) -> float:
        """Bending moment of all strips at that curvature, their strength for any length of the
        bend.
        """
        return self.bending_stiffness_Nm2 * self.breaking_curvature_per_m


def table_1_materials() -> tuple[Material, ...]:
    """The four materials in the table's order."""
    text = (files("rfca_rig.model") / "materials.toml").read_text("utf-8")
    return tuple(
        Material(
            name=row["name"],
            # The file has the units of Table I.
            density_kg_m3=1e3 * row["density_g_cm3"],
            youngs_modulus_Pa=1e9 * row["youngs_modulus_GPa"],
            poisson_ratio=row["poisson_ratio"],
            bending_strength_Pa=1e6 * row["bending_strength_MPa"],
        )
        for row in tomllib.loads(text)["material"]
    )


def paper_strips(material: Material, thickness_m: float = 0.8e-3) -> Strip:
    """Two strips of 226 mm x 25.4 mm as in the paper's leg (section II.A)."""
    return Strip(material, width_m=25.4e-3, thickness_m=thickness_m, length_m=226e-3, count=2)


def cell_m(leg: Leg) -> float:
    """Mean length of strip that one hinge represents. Raises BadInput for a leg of two links,
    from which it does not follow.
    """
    borders = _cells_m(leg)[::2]
    return float((borders[-1] - borders[0]) / (len(leg.link_lengths_m) - 1))


def with_links(leg: Leg, count: int) -> Leg:
    """The leg with `count` links. Raises BadInput below 2 and above 60, and for a leg that has
    two itself.
    """
    hinges = len(leg.link_lengths_m) - 1
    wanted = count - 1
    if wanted == hinges:
        return leg
    if not 2 <= count <= MOST_LINKS:
        raise BadInput(f"a leg of {count} links: it takes 2 to {MOST_LINKS}")
    cells = _cells_m(leg)
    # Each new pin is in the middle of its cell, counted in old cells. `cells` has two borders per
    # cell, hence the half.
    middles = (np.arange(wanted) + 0.5) * hinges / wanted
    pins = np.interp(middles, 0.5 * np.arange(cells.size), cells)
    return _recut(
        leg, np.diff(np.concatenate(([0.0], pins, [sum(leg.link_lengths_m)]))), wanted / hinges
    )


def with_first_link(leg: Leg, first_m: float) -> Leg:
    """The leg with a first link of that length; the others share the rest in their old
    proportion. Raises BadInput where none is left.
    """
    first = leg.link_lengths_m[0]
    rest = sum(leg.link_lengths_m[1:])
    if not 0.0 < first_m < first + rest:
        raise BadInput(
            f"a first link of {1e3 * first_m:g} mm: it must be above 0 and below the "
            f"leg's length, {1e3 * (first + rest):g} mm"
        )
    if first_m == first:
        return leg
    shrunk = (first + rest - first_m) / rest
    return _recut(
        leg,
        np.array([first_m, *(shrunk * length for length in leg.link_lengths_m[1:])]),
        1.0 / shrunk,
    )


def _cells_m(leg: Leg) -> Floats:
    """(2 h + 1,) borders of the hinges' cells and the pins between them, in turn, from the
    shaft.
    """
    if len(leg.link_lengths_m) < 3:
        raise BadInput(
            "a leg of two links does not tell over what length its strip bends; begin "
            "from one of three or more"
        )
    borders = np.cumsum((0.0, *leg.link_lengths_m))
    pins = borders[1:-1]
    between = 0.5 * (pins[:-1] + pins[1:])
    # An end cell reaches as far outwards from its pin as inwards, but not beyond the leg.
    begin = max(2.0 * pins[0] - between[0], 0.0)
    end = min(2.0 * pins[-1] - between[-1], borders[-1])
    cells = np.empty(2 * pins.size + 1)
    cells[::2] = np.concatenate(([begin], between, [end]))
    cells[1::2] = pins
    return cells


def _recut(leg: Leg, lengths_m: Floats, m: float) -> Leg:
    """Other links with the same mass in the same places, and springs for `m` times as many cells
    in a length.
    """
    if any(leg.rest_angles_rad):
        raise BadInput(
            "leg.rest_angles_deg: a leg that is bent at rest cannot be cut into other "
            "links; leave the rest angles out"
        )
    if len(leg.torque_splines) > 1:
        raise BadInput(
            "leg.torque_rotation: a leg with a curve for each hinge cannot be cut into "
            "other links; give one curve for all"
        )
    old = np.cumsum((0.0, *leg.link_lengths_m))
    new = np.concatenate(([0.0], np.cumsum(lengths_m)))
    # Mass is spread evenly over each old link: interpolating its running sum keeps it where it is.
    masses = np.diff(np.interp(new, old, np.cumsum((0.0, *leg.link_masses_kg))))
    return replace(
        leg,
        link_lengths_m=tuple(map(float, lengths_m)),
        link_masses_kg=tuple(map(float, masses)),
        k0_Nm_per_rad=m * leg.k0_Nm_per_rad,
        k2_per_rad2=m**2 * leg.k2_per_rad2,
        torque_splines=tuple(spline.scaled(1.0 / m, 1.0 / m) for spline in leg.torque_splines),
        hinge_damping_Nm_s_per_rad=m * leg.hinge_damping_Nm_s_per_rad,
    )

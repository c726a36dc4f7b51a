"""The leaf spring of the leg, a flat strip, and the materials that the paper compares for it (Table I, stored in materials.toml)."""

import tomllib
from dataclasses import dataclass
from importlib.resources import files


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
    """`count` equal flat strips side by side that bend across their thickness. The stiffness is that of all of them."""

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
        """E I of all strips, each free to curve across its width as a narrow beam does; this is the paper's E I."""
        return self.material.youngs_modulus_Pa * self.second_moment_m4

    @property
    def flattened_bending_stiffness_Nm2(self) -> float:
        """E I / (1 - nu^2): if shells keep the strips flat across their width, as a plate."""
        return self.bending_stiffness_Nm2 / (1.0 - self.material.poisson_ratio**2)

    @property
    def mass_kg(self) -> float:
        """Of all strips."""
        return self.material.density_kg_m3 * self.count * self.width_m * self.thickness_m * self.length_m

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
        """Bending moment of all strips at that curvature, their strength for any length of the bend."""
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

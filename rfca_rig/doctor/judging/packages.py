"""The Python packages that the tool stands on, in versions that it works with."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "python packages"
EXTRAS = "extras"


@dataclass(frozen=True)
class PackageSeen:
    """`wanted` is the requirement as pip takes it; `version` None where it is not installed; `fits` whether it satisfies that."""

    name: str
    wanted: str
    version: str | None
    fits: bool


@dataclass(frozen=True)
class ExtraSeen:
    """What one of the package's extras brings, and so what can be done with it."""

    name: str
    packages: tuple[PackageSeen, ...]


def judge_extras(seen: tuple[ExtraSeen, ...]) -> Finding:
    """None of them is needed by all; one that is there must fit."""
    there = [one for one in seen if all(package.fits for package in one.packages)]
    old = [package for one in seen for package in one.packages if package.version is not None and not package.fits]
    missing = [one.name for one in seen if one not in there]
    said = "; ".join(f"{one.name}: {', '.join(f'{p.name} {p.version}' for p in one.packages)}" for one in there) or "none installed"
    if missing:
        said += f"; not installed: {', '.join(missing)}"
    if old:
        worn = ", ".join(f"{package.name} {package.version}" for package in old)
        return yellow(EXTRAS, f"{said}; too old: {worn}", "install what fits:", "pip install " + " ".join(f'"{one.wanted}"' for one in old))
    return green(EXTRAS, said)


def judge_packages(seen: tuple[PackageSeen, ...], python: str, own_version: str) -> Finding:
    bad = [package for package in seen if not package.fits]
    if bad:
        said = ", ".join(f"{one.name} {'is missing' if one.version is None else one.version}" for one in bad)
        return red(SUBJECT, f"{said}", "install what fits:", "pip install " + " ".join(f'"{one.wanted}"' for one in bad))
    versions = ", ".join(f"{one.name} {one.version}" for one in seen)
    return green(SUBJECT, f"python {python}, rfca-rig {own_version}, {versions}")

"""Evaluates the installed Python packages against the requirements."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "python packages"
EXTRAS = "extras"


@dataclass(frozen=True)
class PackageSeen:
    """Observed package. `wanted` is the pip requirement, `version` None if not installed, `fits` whether it satisfies it."""

    name: str
    wanted: str
    version: str | None
    fits: bool


@dataclass(frozen=True)
class ExtraSeen:
    """Observed packages of one extra (optional feature)."""

    name: str
    packages: tuple[PackageSeen, ...]


def judge_extras(seen: tuple[ExtraSeen, ...]) -> Finding:
    """Finding on the extras. They are optional, but an installed package must have a suitable version."""
    complete = [one for one in seen if all(package.fits for package in one.packages)]
    old = [package for one in seen for package in one.packages if package.version is not None and not package.fits]
    missing = [one.name for one in seen if one not in complete]
    summary = "; ".join(f"{one.name}: {', '.join(f'{p.name} {p.version}' for p in one.packages)}" for one in complete) or "none installed"
    if missing:
        summary += f"; not installed: {', '.join(missing)}"
    if old:
        outdated = ", ".join(f"{package.name} {package.version}" for package in old)
        return yellow(
            EXTRAS, f"{summary}; too old: {outdated}", "install what fits:", "pip install " + " ".join(f'"{one.wanted}"' for one in old)
        )
    return green(EXTRAS, summary)


def judge_packages(seen: tuple[PackageSeen, ...], python: str, own_version: str) -> Finding:
    bad = [package for package in seen if not package.fits]
    if bad:
        problems = ", ".join(f"{one.name} {'is missing' if one.version is None else one.version}" for one in bad)
        return red(SUBJECT, f"{problems}", "install what fits:", "pip install " + " ".join(f'"{one.wanted}"' for one in bad))
    versions = ", ".join(f"{one.name} {one.version}" for one in seen)
    return green(SUBJECT, f"python {python}, rfca-rig {own_version}, {versions}")

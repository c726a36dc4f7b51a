"""The Python packages that the tool stands on, in versions that it works with."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red

SUBJECT = "python packages"


@dataclass(frozen=True)
class PackageSeen:
    """`wanted` is the requirement as pip takes it; `version` None where it is not installed; `fits` whether it satisfies that."""

    name: str
    wanted: str
    version: str | None
    fits: bool


def judge_packages(seen: tuple[PackageSeen, ...], python: str, own_version: str) -> Finding:
    bad = [package for package in seen if not package.fits]
    if bad:
        said = ", ".join(f"{one.name} {'is missing' if one.version is None else one.version}" for one in bad)
        return red(SUBJECT, f"{said}", "install what fits:", "pip install " + " ".join(f'"{one.wanted}"' for one in bad))
    versions = ", ".join(f"{one.name} {one.version}" for one in seen)
    return green(SUBJECT, f"python {python}, rfca-rig {own_version}, {versions}")

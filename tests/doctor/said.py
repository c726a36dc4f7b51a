"""Findings as tests look at them."""

from collections.abc import Iterable

from rfca_rig.devices.checks import Colour, Finding


def colours(findings: Iterable[Finding]) -> dict[str, str]:
    """Colour by subject."""
    return {one.subject: one.colour.value for one in findings}


def whole(finding: Finding) -> str:
    """All that a finding says, and that what is not green says what to do."""
    assert bool(finding.fix) == (finding.colour is not Colour.GREEN), finding
    assert not finding.commands or finding.fix.endswith(":"), finding
    return " | ".join([finding.seen, finding.fix, *finding.commands])

"""The configuration page of an ATI Net F/T, `netftapi2.xml`; pure.

Element names: ATI manual 9620-05-net ft, the chapter on the CGI interface. Of about seventy elements these are the ones that are needed to
interpret a stream.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from xml.etree import ElementTree as Xml

from rfca_rig.codecs.ati_units import newton_metres_per, newtons_per
from rfca_rig.codecs.malformed import MalformedFrame

PATH = "/netftapi2.xml"
# A larger page is not parsed.
MAX_PAGE_BYTES = 1 << 16


@dataclass(frozen=True)
class NetFtConfiguration:
    """Configuration of the box. None where an element is not on its page, as on other models and firmware.

    `rdt_rate_Hz` is the requested rate; the actual one follows from `decimation`. `low_pass` is the code of its filter, "0" for none.
    """

    product: str
    serial_number: str
    force_unit: str
    torque_unit: str
    counts_per_force: float
    counts_per_torque: float
    rdt_enabled: bool | None = None
    rdt_rate_Hz: float | None = None
    internal_rate_Hz: float | None = None
    records_per_datagram: int | None = None
    low_pass: str | None = None

    @property
    def counts_per_N(self) -> float:
        return self.counts_per_force / newtons_per(self.force_unit)

    @property
    def counts_per_Nm(self) -> float:
        return self.counts_per_torque / newton_metres_per(self.torque_unit)

    def decimation(self, internal_rate_Hz: float) -> int | None:
        """Internal samples per record: the box rounds the rate up to the next possible one. None where the page states no rate."""
        # 1e-6 against rounding of an exact ratio, 1e9 against overflow of a tiny rate.
        return None if self.rdt_rate_Hz is None else max(1, int(min(internal_rate_Hz / self.rdt_rate_Hz, 1e9) + 1e-6))


def decode_configuration(page: bytes) -> NetFtConfiguration:
    """Decode the configuration page. Raises MalformedFrame for a page that is not the box's XML, or lacks units or counts."""
    values = _values(page)
    return NetFtConfiguration(
        product=_require(values, "prodname"),
        serial_number=values.get("cfgcalsn", ""),
        force_unit=_unit(values, "scfgfu", newtons_per),
        torque_unit=_unit(values, "scfgtu", newton_metres_per),
        counts_per_force=_positive(values, "cfgcpf"),
        counts_per_torque=_positive(values, "cfgcpt"),
        rdt_enabled=_is_enabled(values, "comrdte"),
        rdt_rate_Hz=_positive(values, "comrdtrate") if "comrdtrate" in values else None,
        internal_rate_Hz=_positive(values, "runrate") if "runrate" in values else None,
        records_per_datagram=int(_positive(values, "comrdtbsiz")) if "comrdtbsiz" in values else None,
        low_pass=values.get("setuserfilter"),
    )


def encode_configuration(configuration: NetFtConfiguration, others: Mapping[str, str]) -> bytes:
    """The page of a configuration, with `others` as additional elements."""
    root = Xml.Element("netft")
    for name, value in {**_elements(configuration), **others}.items():
        Xml.SubElement(root, name).text = value
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _elements(configuration: NetFtConfiguration) -> dict[str, str]:
    known = {
        "prodname": configuration.product,
        "cfgcalsn": configuration.serial_number,
        "scfgfu": configuration.force_unit,
        "scfgtu": configuration.torque_unit,
        "cfgcpf": f"{configuration.counts_per_force:.10g}",
        "cfgcpt": f"{configuration.counts_per_torque:.10g}",
        "comrdte": None if configuration.rdt_enabled is None else ("Enabled" if configuration.rdt_enabled else "Disabled"),
        "comrdtrate": None if configuration.rdt_rate_Hz is None else f"{configuration.rdt_rate_Hz:.10g}",
        "runrate": None if configuration.internal_rate_Hz is None else f"{configuration.internal_rate_Hz:.10g}",
        "comrdtbsiz": None if configuration.records_per_datagram is None else str(configuration.records_per_datagram),
        "setuserfilter": configuration.low_pass,
    }
    return {name: value for name, value in known.items() if value is not None}


def _values(page: bytes) -> dict[str, str]:
    # A document type could define entities that expand without limit.
    if len(page) > MAX_PAGE_BYTES or b"<!DOCTYPE" in page:
        raise MalformedFrame(f"page of {len(page)} bytes is no configuration page of a Net F/T")
    try:
        root = Xml.fromstring(page)
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise MalformedFrame(f"configuration page is not XML: {error}") from None
    if root.tag != "netft":
        raise MalformedFrame(f"configuration page begins with <{root.tag[:40]}>, expected <netft>")
    return {child.tag: (child.text or "").strip() for child in root}


def _require(values: Mapping[str, str], name: str) -> str:
    if not values.get(name):
        raise MalformedFrame(f"configuration page lacks {name}")
    return values[name]


def _unit(values: Mapping[str, str], name: str, size: Callable[[str], float]) -> str:
    unit = _require(values, name)
    # Raises for an unknown unit here, where the page is read, and not at the first force.
    size(unit)
    return unit


def _positive(values: Mapping[str, str], name: str) -> float:
    text = _require(values, name)
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or value <= 0.0:
        raise MalformedFrame(f"configuration page: {name} is {text[:40]!r}, must be a number above 0")
    return value


def _is_enabled(values: Mapping[str, str], name: str) -> bool | None:
    text = values.get(name)
    if text is not None and text not in {"Enabled", "Disabled"}:
        raise MalformedFrame(f"configuration page: {name} is {text[:40]!r}, expected Enabled or Disabled")
    return None if text is None else text == "Enabled"

"""Reads what the Linux kernel says of its CAN interfaces."""

import json
import subprocess
from pathlib import Path
from typing import Any

from rfca_rig.doctor.judging.can_interface import CanInterfaceSeen

NETWORK = Path("/sys/class/net")
ARPHRD_CAN = "280"  # linux/if_arp.h
IFF_UP = 1
CANFD_MTU = 72
IP_WITHIN_S = 2.0


def look_at_can_interface(channel: str, network: Path = NETWORK) -> CanInterfaceSeen:
    """The bit rate is known only where there is the command `ip`."""
    names = can_interfaces(network)
    others = tuple(name for name in names if name != channel)
    if not channel or "/" in channel or not (network / channel).exists():
        return CanInterfaceSeen(channel, False, others)
    told = _told_by_ip(channel) if network == NETWORK else {}
    info = told.get("linkinfo", {})
    data = info.get("info_data", {})
    return CanInterfaceSeen(
        channel=channel,
        exists=True,
        others=others,
        is_can=channel in names,
        is_virtual=info.get("info_kind", "") in {"vcan", "vxcan"},
        is_up=bool(int(_text(network / channel / "flags") or "0", 16) & IFF_UP),
        state=data.get("state"),
        bitrate=data.get("bittiming", {}).get("bitrate"),
        data_bitrate=data.get("data_bittiming", {}).get("bitrate"),
        is_fd=_text(network / channel / "mtu") == str(CANFD_MTU),
    )


def can_interfaces(network: Path = NETWORK) -> tuple[str, ...]:
    """Every CAN interface of the kernel, by name."""
    if not network.is_dir():
        return ()
    return tuple(sorted(entry.name for entry in network.iterdir() if _text(entry / "type") == ARPHRD_CAN))


def _text(file: Path) -> str:
    """Empty for a file that is not there: interfaces come and go."""
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def _told_by_ip(channel: str) -> dict[str, Any]:
    """What `ip` says of the interface; nothing where it is not installed, or too old for JSON."""
    command = ["ip", "-details", "-json", "link", "show", "dev", channel]
    try:
        said = subprocess.run(command, capture_output=True, timeout=IP_WITHIN_S, check=True).stdout
        links = json.loads(said)
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
    return links[0] if links and isinstance(links[0], dict) else {}

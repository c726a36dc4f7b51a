"""Serial ports: there, and open to this user."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "serial port"


@dataclass(frozen=True)
class SerialPortSeen:
    """`group` owns the port, None where the system has no such thing; `others` are the serial ports besides."""

    path: str
    exists: bool
    may_open: bool = False
    group: str | None = None
    others: tuple[str, ...] = ()
    product: str = ""


def judge_serial_port(seen: SerialPortSeen, section: str) -> Finding:
    """A port that the rig file names under `section`."""
    if not seen.exists:
        there = f"there is {', '.join(seen.others)}" if seen.others else "there is no serial port at all"
        return red(SUBJECT, f"there is no {seen.path}; {there}", f"plug the cable in, or name the right port under {section}")
    if not seen.may_open:
        return red(SUBJECT, f"{seen.path} is not open to you{_owned(seen)}", *_permission(seen))
    return green(SUBJECT, f"{seen.path} {seen.product}".strip())


def judge_found_port(seen: SerialPortSeen) -> Finding:
    """A port that was found; not being allowed to use it may not matter."""
    if not seen.may_open:
        return yellow(SUBJECT, f"{seen.path} {seen.product}".strip() + f", not open to you{_owned(seen)}", *_permission(seen))
    return green(SUBJECT, f"{seen.path} {seen.product}".strip())


def _owned(seen: SerialPortSeen) -> str:
    return "" if seen.group is None else f", it belongs to the group {seen.group}"


def _permission(seen: SerialPortSeen) -> tuple[str, ...]:
    """Joining root's own group would give away too much; a rule of udev does not."""
    if seen.group is None or seen.group == "root":
        return "let yourself in until the next restart:", f"sudo chmod a+rw {seen.path}"
    return "join the group, then log out and in again:", f"sudo usermod -aG {seen.group} $USER"

"""rfca-rig twin: the twin rig as a server for any client of the same wires, and what is made from
it.
"""

import json
import socket
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Command, Rig, Seed
from rfca_rig.cli.paths import check_writable, find_shipped, write_twin_rig
from rfca_rig.cli.terminal import echo, print_lines
from rfca_rig.errors import BadInput, DeviceError, Stopped

RDT_PORT = 49152
COMMAND_PORT = 49151
HTTP_PORT = 8080
CAN_PORT = 29536
CONTROL_PORT = 49160
ANSWER_WITHIN_S = 5.0
# A loop of the springs.
DEFAULT_SEED = 6

app = typer.Typer(
    name="twin",
    help="The twin rig as a server in real time, for clients of the same wires.",
    no_args_is_help=True,
)


@app.command("serve", cls=Command)
def serve(
    rig: Rig = "twin",
    seed: Seed = None,
    listen: Annotated[
        str,
        typer.Option(
            "--listen",
            metavar="ADDRESS",
            help="Address to listen on; this machine only if not given.",
        ),
    ] = ("127.0.0.1"),
    rdt_port: Annotated[
        int,
        typer.Option(
            "--rdt-port",
            metavar="PORT",
            min=0,
            max=65535,
            help="UDP port of the force sensor; 0 is any.",
        ),
    ] = RDT_PORT,
    http_port: Annotated[
        int,
        typer.Option(
            "--http-port",
            metavar="PORT",
            min=0,
            max=65535,
            help="TCP port of the sensor's web page; 0 is any.",
        ),
    ] = HTTP_PORT,
    command_port: Annotated[
        int,
        typer.Option(
            "--command-port",
            metavar="PORT",
            min=0,
            max=65535,
            help="TCP port of its commands; 0 is any.",
        ),
    ] = COMMAND_PORT,
    can_port: Annotated[
        int,
        typer.Option(
            "--can-port",
            metavar="PORT",
            min=0,
            max=65535,
            help="TCP port of CAN as socketcand; 0 is any.",
        ),
    ] = CAN_PORT,
    control_port: Annotated[
        int,
        typer.Option(
            "--control-port",
            metavar="PORT",
            min=0,
            max=65535,
            help="TCP port of the control lines; 0 is any.",
        ),
    ] = CONTROL_PORT,
    slcan: Annotated[
        bool,
        typer.Option("--slcan", help="Also offer CAN as a serial adapter on a pseudo terminal."),
    ] = False,
    height: Annotated[
        float,
        typer.Option(
            "--height",
            metavar="MM",
            min=1.0,
            max=999.0,
            help="Height of the shaft above the ground.",
        ),
    ] = 250.0,
    new_drive: Annotated[
        bool,
        typer.Option(
            "--new-drive",
            help="The drive is as it leaves its maker: wrong rates, no watchdog (setup motor).",
        ),
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            "--fault",
            metavar="NAME@SECONDS",
            help="Switch a fault (--list) on then, or NAME@FROM-TO; may be repeated.",
        ),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(
            "--seconds", metavar="S", min=0.0, help="End after that long; 0 goes on until ^C."
        ),
    ] = 0.0,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print one line of JSON with the ports on standard output."),
    ] = False,
    lists: Annotated[
        bool, typer.Option("--list", help="Print the faults that the devices of --rig can have.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing.")] = False,
) -> None:
    """Let third-party clients talk to the twins: force sensor on UDP, motor on CAN over TCP; faults
    can be switched meanwhile.

    ^C ends it.

    Example: rfca-rig twin serve --fault force-lost@2-4
    """
    from rfca_rig.bench.fault_injection import faults_of_served_rig
    from rfca_rig.bench.served import open_served
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.cli.progress import COMPILE_NOTICE, make_marked_say
    from rfca_rig.clock import WallClock
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.model.kernel.compiled import is_warm
    from rfca_rig.twin_server.faults import parse_fault_events
    from rfca_rig.twin_server.open_ports import Openings
    from rfca_rig.twin_server.tcp import is_loopback

    say = make_marked_say("SIM", quiet)
    orders = parse_fault_events(fault or [])
    described = read_rig(find_rig(rig))
    if lists:
        print_lines(
            (
                f"{known_fault.name:<22}{known_fault.meaning}"
                for known_fault in faults_of_served_rig(described)
            ),
            indent=" " * 22,
        )
        return
    # There is no password, so opening the server to the network needs a warning.
    if not is_loopback(listen):
        say(
            f"WARNING open to the network: anybody who reaches {listen} can command this "
            "twin and read it; there is no password"
        )
    if not is_warm():
        say(COMPILE_NOTICE)
    if seed is not None:
        twin_seed = seed
    elif described.twin:
        twin_seed = described.twin.seed
    else:
        twin_seed = 0
    openings = Openings(
        listen,
        rdt_port,
        http_port,
        command_port,
        can_port,
        control_port,
        slcan,
        1e-3 * height,
        new_drive,
    )
    with open_served(described, twin_seed, openings, WallClock()) as served:
        try:
            for address in served.reached.addresses:
                say(address)
            if as_json:
                echo(json.dumps(served.reached.names))
            served.serve(
                orders,
                seconds or float("inf"),
                lambda fault: say(f"fault {fault.words}"),
            )
        except KeyboardInterrupt:
            raise Stopped(f"stopped by the operator; {served.status()}") from None
        say(served.status())


@app.command("board", cls=Command)
def board(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the photos.")],
    rig: Rig = "twin",
    seed: Seed = None,
) -> None:
    """Write photos of a ChArUco board through the twin's camera, to calibrate it as a lab does its
    own.

    Example: rfca-rig twin board board
    """
    from rfca_rig.bench.board_session import PLANE_CORNER_MM, PLANE_PHOTO, write_board_photos
    from rfca_rig.cli.commands.calibrate import BOARD
    from rfca_rig.cli.options import out_folder
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.cli.progress import progress
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.vision.board import parse_board

    out_folder(folder)
    with progress(quiet=False) as bars:
        files = write_board_photos(
            read_rig(find_rig(rig)),
            parse_board(BOARD),
            folder,
            seed,
            bars.counting("taking photos"),
        )
    across_mm, up_mm = PLANE_CORNER_MM
    echo(f"SIM {len(files)} photos of a board in {folder}", err=True)
    echo(
        f"next: rfca-rig calibrate camera {folder} --plane {folder / PLANE_PHOTO} "
        f"--board-at {across_mm:g},{up_mm:g} --out camera.toml",
        err=True,
    )


@app.command("conceal", cls=Command)
def conceal(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="The rig file to write.")],
    seed: Annotated[
        int,
        typer.Option(
            "--seed", metavar="N", min=0, help="What is drawn; each N has its own effect."
        ),
    ] = DEFAULT_SEED,
) -> None:
    """Write a rig file of the twin with a concealed effect that its model lacks: in the leg, the
    floor or the frame.

    Its drive follows every command. The effect is sealed in the file; diagnose --reveal opens it.

    Example: rfca-rig twin conceal riddle.toml --seed 7
    """
    import numpy as np

    from rfca_rig.bench.concealment import conceal as conceal_effect
    from rfca_rig.bench.concealment import draw_concealed
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.toml import model_of, read_text

    check_writable(path)
    shipped = find_shipped("calibration")
    usual = read_text(shipped / "twin.toml")
    rig = model_of(usual, RigFile, shipped / "twin.toml")
    text = conceal_effect(usual, draw_concealed(rig, np.random.default_rng(seed)))
    # Nothing is written that the other commands would refuse.
    model_of(text, RigFile, path)
    write_twin_rig(path, text)
    echo(f"{path}: a twin with an effect that its model lacks")
    echo(f"then: rfca-rig dynamic run --protocol table2 --rig {path}", err=True)
    echo("and: rfca-rig diagnose RUN --reveal, with the folder that it names", err=True)


@app.command("tell", cls=Command)
def tell(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="WORD",
            help="on NAME, off NAME, off all, faults, status, height MM, hold DEG, let go, "
            "push FX FY FZ [LEVER_MM], or tool LINE.",
        ),
    ],
    control_port: Annotated[
        int,
        typer.Option(
            "--control-port", metavar="PORT", min=1, max=65535, help="Where the server listens."
        ),
    ] = CONTROL_PORT,
) -> None:
    """Switch faults of a running server, ask how it is, or type a line in the drive's own tool.

    Example: rfca-rig twin tell on force-silent
    """
    answer = _send_command(" ".join(words), control_port)
    if answer[-1].startswith("error "):
        raise BadInput(answer[-1].removeprefix("error "))
    for line in answer[:-1]:
        echo(line)


def _send_command(line: str, port: int) -> list[str]:
    """Sends a line; returns the lines of the answer, `ok` or `error ...` last."""
    answer = ""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=ANSWER_WITHIN_S) as connection:
            connection.sendall(f"{line}\n".encode())
            # TCP may deliver an answer in pieces.
            while not answer.endswith("ok\n") and "error " not in answer:
                received = connection.recv(1 << 16)
                if not received:
                    raise DeviceError(
                        f"the server on port {port} hung up; is it rfca-rig twin serve?"
                    )
                answer += received.decode("ascii", "replace")
    except OSError as error:
        raise DeviceError(
            f"no answer on port {port}: {error}; is rfca-rig twin serve running, with "
            "that --control-port?"
        ) from error
    return answer.splitlines()

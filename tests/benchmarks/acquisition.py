"""Force records and a command loop at full speed, over real sockets.

Run: python -m tests.benchmarks.acquisition [--seconds 600]

A box in a process of its own sends 7000 and 15 000 records/s, one and 40 to a datagram. This
process reads them through the acquisition process, and commands a drive in a third process over
socketcand at 500 Hz. Shown are records lost, processor shares in per cent of one core, and the gaps
between commands as the drive saw them.
"""

import argparse
import socket
import time
from contextlib import closing
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import can
import numpy as np

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.clock import WallClock
from rfca_rig.codecs import classic_can
from rfca_rig.devices.netft.driver import NetFtSensor, record_source
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from tests.acquisition.sender import sending

TICK_S = 2e-3
TICKS_PER_S = 100.0  # of /proc/PID/stat on Linux
WATCHDOG_S = 0.1


def listening_drive(pipe: Connection) -> None:
    """A drive that only listens: tells its port, then the gaps between the frames it heard [s]
    once the other side hung up.
    """
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        pipe.send(server.getsockname()[1])
        client, _ = server.accept()
    heard = []
    with closing(client):
        client.sendall(classic_can.GREETING)
        while data := client.recv(4096):
            if b"open" in data or b"rawmode" in data:
                client.sendall(classic_can.OK)
            else:
                heard += [time.monotonic()] * data.count(b"<")
    pipe.send(np.diff(heard))


def processor_s(process_id: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def one(rate_Hz: float, in_one: int, seconds: float) -> str:
    context = get_context("spawn")
    here, there = context.Pipe()
    drive = context.Process(target=listening_drive, args=(there,), daemon=True)
    drive.start()
    clock = WallClock()
    bus = can.Bus(
        interface="socketcand", channel="can0", host="127.0.0.1", port=here.recv(), tcp_tune=True
    )
    motor = OdriveMotor(bus, clock, OdriveSettings(node_id=0))
    with sending(rate_Hz, in_one, seconds) as (port, pipe):
        datagrams = AcquiredDatagrams(record_source("127.0.0.1", port), clock)
        sensor = NetFtSensor(
            datagrams, clock, NetFtSettings(rate_Hz=rate_Hz, internal_rate_Hz=rate_Hz)
        )
        sensor.start()
        reader_s = processor_s(datagrams.process_id)
        loop_s = time.process_time()
        began_s = clock.now_s()
        due_s = began_s
        while not pipe.poll():
            motor.command_speed(1.0)
            sensor.read()
            due_s = max(due_s + TICK_S, clock.now_s())
            clock.wait_until(due_s)
        elapsed_s = clock.now_s() - began_s
        reader = processor_s(datagrams.process_id) - reader_s
        loop = time.process_time() - loop_s
        sent = pipe.recv()
        clock.wait_until(clock.now_s() + 0.2)
        sensor.read()
        health = sensor.health()
        granted = datagrams.receive_buffer_bytes
        datagrams.close()
    bus.shutdown()
    gaps_ms = 1e3 * here.recv()
    drive.join()
    lost = sent - health.received
    return (
        f"{rate_Hz:6.0f} records/s, {in_one:2d} in one: {sent:9d} sent, {lost} lost, "
        f"reader {100 * reader / elapsed_s:4.1f} %, "
        f"this loop {100 * loop / elapsed_s:4.1f} %, receive buffer {granted} B; "
        f"commands: median {np.median(gaps_ms):.2f}, p99 "
        f"{np.percentile(gaps_ms, 99):.2f}, worst {gaps_ms.max():.2f} ms"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds",
        type=float,
        default=10.0,
        help="length of each of the four; 600 for the long one",
    )
    seconds = parser.parse_args().seconds
    print(f"command gaps must stay below half the drive's watchdog of {1e3 * WATCHDOG_S:.0f} ms")
    for rate_Hz in (7000.0, 15000.0):
        for in_one in (1, 40):
            print(one(rate_Hz, in_one, seconds), flush=True)


if __name__ == "__main__":
    main()

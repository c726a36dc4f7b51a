"""A sensor box in a process of its own: sends numbered records at a rate once it is asked to, as
fast or slow as it is told.
"""

import multiprocessing
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

import numpy as np

from rfca_rig.devices.netft.codec import RdtCommand, Records, decode_request, encode_records

BURST_S = 1e-3


Made = Callable[[int, int], bytes]


def send_records(pipe: Connection, rate_Hz: float, in_one: int, seconds: float, made: Made) -> None:
    """Waits for a start request, then sends for that long; tells its port first and the number
    of records last.
    """
    box = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    box.bind(("127.0.0.1", 0))
    pipe.send(box.getsockname()[1])
    while True:
        request, client = box.recvfrom(100)
        if decode_request(request).command in {RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED}:
            break
    sent = 0
    began = time.monotonic()
    while (running_s := time.monotonic() - began) < seconds:
        while sent + in_one <= running_s * rate_Hz:
            box.sendto(made(sent + 1, in_one), client)
            sent += in_one
        time.sleep(BURST_S)
    pipe.send(sent)
    pipe.recv()


def datagram(first: int, count: int) -> bytes:
    """Records whose counts are their own number."""
    numbers = np.arange(first, first + count).astype(np.uint32)
    return encode_records(
        Records(
            numbers,
            numbers,
            np.zeros(count, np.uint32),
            np.repeat(numbers.view(np.int32)[:, None], 6, axis=1),
        )
    )


def restless(first: int, count: int) -> bytes:
    """Records of which every axis jumps about, by up to 100 N or N m at a million counts each;
    the number alone decides.
    """
    numbers = np.arange(first, first + count).astype(np.uint32)
    mixed = (numbers[:, None] + np.arange(6, dtype=np.uint32) * np.uint32(7919)) * np.uint32(
        2654435761
    )
    counts = (mixed ^ (mixed >> np.uint32(15))) % np.uint32(200_000_001)
    return encode_records(
        Records(numbers, numbers, np.zeros(count, np.uint32), counts.astype(np.int32) - 100_000_000)
    )


@contextmanager
def sending(
    rate_Hz: float, in_one: int, seconds: float, made: Made = datagram
) -> Iterator[tuple[int, Connection]]:
    """(port, pipe): the pipe tells how many records were sent once that is over."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(
        target=send_records, args=(there, rate_Hz, in_one, seconds, made), daemon=True
    )
    process.start()
    try:
        yield here.recv(), here
    finally:
        process.kill()
        process.join()

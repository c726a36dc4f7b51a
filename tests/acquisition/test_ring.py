"""The ring of records: what is written is read, in order, once, and an overrun shows."""

import errno
import os
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.acquisition.ring import Ring, RingReader
from rfca_rig.errors import DeviceError
from rfca_rig.recording.block_queue import BlockQueue

BYTES = 8


@pytest.fixture
def ring():
    made = Ring.create(16, BYTES)
    yield made
    made.remove()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    "create", [lambda: Ring.create(16, BYTES), lambda: BlockQueue.create(4096)]
)
def test_memory_that_the_system_has_no_room_for_is_refused_at_once(monkeypatch, create):
    """Not at the first write, which would kill the process with the motor on."""
    files = []

    def refuse(descriptor, *_):
        files.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", refuse)
    with pytest.raises(
        DeviceError, match=r"0\.1 MB of shared memory .* No space left on device; .* --shm-size"
    ):
        create()
    assert files and not files[0].exists()


def numbered(first: int, count: int) -> np.ndarray:
    return np.arange(first, first + count, dtype=np.uint64).view(np.uint8).reshape(count, BYTES)


def numbers(records: np.ndarray) -> list[int]:
    return np.ascontiguousarray(records).view(np.uint64).ravel().tolist()


@given(st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=30))
@settings(max_examples=50, deadline=None)
def test_every_record_is_read_once_in_order_or_counted_as_overrun(
    steps: list[tuple[int, bool]],
) -> None:
    ring = Ring.create(16, BYTES)
    try:
        reader = RingReader(ring)
        written = 0
        seen = []
        for count, read in [*steps, (0, True)]:
            ring.write(float(written), numbered(written, count))
            written += count
            if read:
                missed = reader.overrun
                block = reader.read()
                assert numbers(block.records) == list(range(written - len(block.records), written))
                assert reader.overrun - missed == block.overrun
                seen += numbers(block.records)
        assert seen == sorted(set(seen))
        assert len(seen) + reader.overrun == written == ring.published
        assert not steps or len(seen) >= min(steps[-1][0], 16)
    finally:
        ring.remove()


def test_a_stamp_goes_with_each_record_over_the_wrap(ring):
    reader = RingReader(ring)
    for n in range(5):
        ring.write(0.1 * n, numbered(5 * n, 5))
        block = reader.read()
        assert block.t_s.tolist() == [0.1 * n] * 5
        assert numbers(block.records) == list(range(5 * n, 5 * n + 5))


def test_what_is_overwritten_while_it_is_copied_is_dropped_and_counted(ring):
    """The writer goes on between the copy and the look at its claim."""
    ring.write(0.0, numbered(0, 16))
    claimed = ring.copy_records

    def overtaken(first: int, end: int):
        t_s, records, _ = claimed(first, end)
        ring.write(1.0, numbered(16, 6))
        return t_s, records, claimed(first, end)[2]

    reader = RingReader(ring, from_oldest=True)
    ring.copy_records = overtaken
    block = reader.read()
    assert (numbers(block.records), block.overrun) == (list(range(6, 16)), 6)
    del ring.copy_records
    assert numbers(reader.read().records) == list(range(16, 22))


def test_a_claim_without_its_publication_is_neither_read_nor_trusted(ring):
    ring.write(0.0, numbered(0, 16))
    reader = RingReader(ring, from_oldest=True)
    ring._header[3] = 20  # the writer has begun on four more
    block = reader.read()
    assert (numbers(block.records), block.overrun) == (list(range(4, 16)), 4)


def test_readers_do_not_disturb_each_other(ring):
    one = RingReader(ring)
    other = RingReader(ring)
    ring.write(0.0, numbered(0, 3))
    assert numbers(one.read().records) == [0, 1, 2]
    ring.write(0.0, numbered(3, 2))
    assert numbers(other.read().records) == [0, 1, 2, 3, 4]
    assert numbers(one.read().records) == [3, 4]
    assert numbers(RingReader(ring, from_oldest=True).read().records) == [0, 1, 2, 3, 4]
    assert numbers(RingReader(ring).read().records) == []


def test_a_view_in_another_program_reads_and_leaves_the_ring_in_place(ring):
    ring.write(0.0, numbered(7, 2))
    look = f"from rfca_rig.acquisition.ring import *; ring = Ring.attach({ring.name!r}); "
    look += "print(RingReader(ring, True).read().records[:, 0].tolist()); ring.close()"
    for _ in range(2):
        seen = subprocess.run(
            [sys.executable, "-c", look], capture_output=True, text=True, timeout=60, check=True
        )
        assert (seen.stdout, seen.stderr) == ("[7, 8]\n", "")


def test_a_ring_that_is_not_there_is_said_so():
    with pytest.raises(DeviceError, match="no shared memory called rfca-none"):
        Ring.attach("rfca-none")


def test_memory_that_is_no_ring_is_refused():
    from multiprocessing.shared_memory import SharedMemory

    memory = SharedMemory(create=True, size=4096)
    try:
        with pytest.raises(DeviceError, match="not a ring"):
            Ring.attach(memory.name)
    finally:
        memory.close()
        memory.unlink()


def write_on(name: str, count: int) -> None:
    ring = Ring.attach(name)
    for n in range(0, count, 7):
        ring.write(0.0, np.repeat(numbered(n, 7), 8, axis=1))
    ring.close()


def test_no_record_is_ever_half_one_and_half_another():
    """A writer in another process goes round a small ring as fast as it can while this one
    reads.
    """
    ring = Ring.create(256, 8 * BYTES)
    count = 21_000
    seen = 0
    reader = RingReader(ring)
    writer = get_context("spawn").Process(target=write_on, args=(ring.name, count))
    writer.start()
    try:
        while writer.is_alive() or ring.published > seen + reader.overrun:
            records = reader.read().records
            seen += len(records)
            whole = records.reshape(-1, BYTES, 8)
            assert (whole == whole[:, :, :1]).all()
            first = np.ascontiguousarray(whole[:, :, 0]).view(np.uint64).ravel()
            assert (np.diff(first) == 1).all()
    finally:
        writer.join(20.0)
        ring.remove()
    assert seen + reader.overrun == count
    assert seen > 0

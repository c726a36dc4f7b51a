"""Whatever the order in which things happen, the drive never moves unwatched: random sequences,
on a clock of the test's own.
"""

import numpy as np
import pytest

from rfca_rig.guardian.link import RecordKind
from tests.guardian.inside import EXIT, LAST_WORD, LIMP, SILENCE_S, Inside, inside

PAUSES_S = (0.0, 0.001, 0.01, 0.09, 0.11, 0.5)
ACTS = ("command", "command", "command", "arm", "exit", "round", "round")
Done = list[tuple[str, float]]


@pytest.mark.parametrize("seed", range(100))
def test_commands_reach_the_drive_only_while_they_keep_coming(seed):
    random = np.random.default_rng(seed)
    done: Done = []
    with inside() as i:
        heard: list[bytes] = []
        for _ in range(60):
            done.append((str(random.choice(ACTS)), i.clock.now_s()))
            act(i, done[-1][0], len(done) - 1)
            heard += i.heard()
            i.clock.wait_until(i.clock.now_s() + random.choice(PAUSES_S))
        i.rounds(SILENCE_S + 0.01)
        heard += i.heard()
        assert len(i.told(RecordKind.LET_GO)) <= [name for name, _ in done].count("arm")
    commands = [int.from_bytes(data, "big") for data in heard if data not in {LIMP, EXIT}]
    assert [number for number in commands if not is_watched(done, number)] == []
    assert not heard or heard[-1] in {LIMP, EXIT}, "the drive was left with a command"


def act(i: Inside, name: str, number: int) -> None:
    match name:
        case "command":
            i.command(number)
        case "arm":
            i.arm(number)
        case "exit":
            i.confirmed(LAST_WORD.frames()[-1])
        case _:
            i.guardian.round(i.clock.now_s())


def is_watched(done: Done, number: int) -> bool:
    """Whether an unbroken row of commands leads back from this one to an arming, no silence in
    it longer than agreed.
    """
    until_s = done[number][1]
    for name, at_s in reversed(done[:number]):
        if name == "exit" or until_s - at_s > SILENCE_S + 1e-9:
            return False
        if name == "arm":
            return True
        if name == "command":
            until_s = at_s
    return False

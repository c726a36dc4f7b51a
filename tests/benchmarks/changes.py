"""How answers about changes since a reference are marked and counted, whatever the rig."""

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rfca_rig.model.catalogue import list_related, members_of
from tests.benchmarks.servo import describe_answer

SIZES_IN_LIMITS = (0.0, 1.0, 2.0, 4.0, 8.0)
MARKS = ("effect", "slot", "wrong", "silent")
# From so many limits on, silence is a miss.
CLEAR_LIMITS = 4.0
STDS_OF_90 = 1.645


@dataclass(frozen=True)
class MarkedPair:
    """One pair with its answer, as the tables count it.

    Parameters
    ----------
    said
        The answer, as `reference.plain_answer` has it, with the pair's number and kind.
    right
        The effects that are right; none where nothing has changed.
    is_two
        Whether two things have changed.
    limits
        The change in detection limits, of two the smaller one; 0 where nothing has changed.
    size_errors
        Of each size stated: its error as a share, and whether its 90 % interval holds the truth.
    """

    said: dict[str, Any]
    right: frozenset[str]
    is_two: bool
    limits: float
    size_errors: tuple[tuple[float, bool], ...]

    @property
    def mark(self) -> str:
        """effect, slot, wrong or silent; of an unchanged pair every statement is wrong.

        Of two changes, one that is stated alone is right.
        """
        stated = frozenset(self.said["effects"])
        if stated:
            if stated <= self.right:
                return "effect"
            if stated <= list_related(self.right):
                return "slot"
            return "wrong"
        family = self.said["family"]
        if family is not None:
            return "slot" if members_of(family["id"]) & self.right else "wrong"
        return "silent"


def print_kinds(pairs, kinds):
    """Marks by what has changed, and how often its family is in the most probable set of effects;
    pairs with the reference's motions and others apart.
    """
    for is_other in (False, True):
        print("other motions" if is_other else "the same motions")
        print(f"  {'changed':<24}" + "".join(f"{word:>8}" for word in (*MARKS, "first", "of")))
        for kind in dict.fromkeys(kinds):
            row = [p for p in pairs if p.said["kind"] == kind and p.said["is_other"] == is_other]
            counts = Counter(pair.mark for pair in row)
            numbers = [counts[word] for word in MARKS]
            first = sum(is_first(pair) for pair in row)
            cells = "".join(f"{number:>8}" for number in (*numbers, first, len(row)))
            print(f"  {kind:<24}{cells}")


def is_first(pair):
    """Whether the most probable set of effects has a family of the change."""
    sets = [ids for ids, _ in pair.said["rivals"] if ids and ids != ["unknown"]]
    return bool(sets) and bool(set(sets[0]) & list_related(pair.right))


def print_marks(pairs, motions):
    """Marks by size of the change, sizes, and claims of unchanged pairs, those with the same
    `motions` as the reference's and others apart.
    """
    for is_other in (False, True):
        group = [pair for pair in pairs if pair.said["is_other"] == is_other]
        if not group:
            continue
        print(f"other {motions}" if is_other else f"the same {motions}")
        unchanged = [pair for pair in group if not pair.right]
        claims = sum(pair.mark != "silent" for pair in unchanged)
        print(f"  nothing changed: {claims} claims in {len(unchanged)}")
        print(f"  {'change / limit':<26}" + "".join(f"{word:>8}" for word in MARKS))
        for label, is_two in (("one change", False), ("two changes", True)):
            for low, high in pairwise((*SIZES_IN_LIMITS, np.inf)):
                row = [
                    pair
                    for pair in group
                    if pair.right and pair.is_two == is_two and low <= pair.limits < high
                ]
                counts = Counter(pair.mark for pair in row)
                numbers = "".join(f"{counts[word]:>8}" for word in MARKS)
                print(f"  {f'{label}, {low:g} to {high:g}':<26}{numbers}")
        errors = [error for pair in group for error in pair.size_errors]
        if errors:
            median = np.median([abs(error) for error, _ in errors])
            held = sum(is_held for _, is_held in errors)
            print(
                f"  size error: median {100.0 * median:.1f} %; "
                f"90 % intervals hold {held} of {len(errors)}"
            )


def print_misses(pairs, motions):
    """A line for each wrong statement, silence at CLEAR_LIMITS and more, and size outside."""
    for pair in pairs:
        notes = []
        if pair.mark == "wrong":
            notes.append("wrong")
        if pair.right and pair.mark in ("silent", "slot") and pair.limits >= CLEAR_LIMITS:
            notes.append(pair.mark)
        for error, is_held in pair.size_errors:
            if not is_held:
                notes.append(f"size {100.0 * error:+.0f} %")
        if notes:
            other = f", other {motions}" if pair.said["is_other"] else ""
            head = f"pair {pair.said['number']}, {pair.said['kind']}, {pair.limits:.1f} limits"
            print(f"{head}{other}: {', '.join(notes)}; {describe_answer(pair.said)}")

"""Concatenation of blocks of columns, as devices deliver them."""

from collections.abc import Sequence
from dataclasses import fields
from typing import TypeVar

import numpy as np

from rfca_rig.codecs.rdt import Records
from rfca_rig.drivers.roles import ForceSamples, ShaftSamples

Block = TypeVar("Block", ShaftSamples, ForceSamples, Records)


def concatenate_blocks(blocks: Sequence[Block]) -> Block:
    """Concatenates blocks of columns (m, ...) along the first axis, column by column; a single block is returned as it is."""
    # One block per tick is the usual case.
    if len(blocks) == 1:
        return blocks[0]
    kind = type(blocks[0])
    return kind(*(np.concatenate([getattr(block, column.name) for block in blocks]) for column in fields(kind)))

"""Decimation of a line for drawing: the minimum and maximum of every column of pixels."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def envelope(x: Floats, y: Floats, columns: int) -> tuple[Floats, Floats]:
    """At most two points, minimum and maximum, for each of `columns` equal intervals of x, so that no peak is lost.

    Parameters
    ----------
    x
        Positions (m,), ascending.
    y
        Values (m,), without NaN.
    columns
        Number of intervals.

    Returns
    -------
    x, y
        The points kept, both (k,), in their order, k <= 2 columns; all points where m <= 2 columns.
    """
    if len(x) <= 2 * columns:
        return x, y
    # The last point lies on the right border and would open a column of its own.
    column = np.minimum(((x - x[0]) / (x[-1] - x[0]) * columns).astype(np.intp), columns - 1)
    # Sorted by column, then by value: the first and the last entry of a column are its extremes.
    order = np.lexsort((y, column))
    starts = np.flatnonzero(np.diff(column[order], prepend=-1))
    ends = np.append(starts[1:], len(order)) - 1
    keep = np.unique(np.concatenate([order[starts], order[ends]]))
    return x[keep], y[keep]

"""Draws of a diagnosis as a tree of xarray datasets, in the groups and dimensions that ArviZ reads.

References
----------
InferenceData schema specification, python.arviz.org; since ArviZ 1 its trees are `xarray.DataTree`.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations, unit_of
from rfca_rig.diagnosis.posterior_draws import RivalDraws
from rfca_rig.notebook.recordings import require

if TYPE_CHECKING:
    import xarray

Floats = NDArray[np.float64]

# Diagnostics of ArviZ compare chains, so there are several, although all draws are independent.
CHAINS = 4
RIVALS = "rivals"
NOTHING = "nothing"


def make_datatree(
    rows: Observations, rivals: Sequence[RivalDraws], described: Mapping[str, Any]
) -> "xarray.DataTree":
    """The groups of the first rival at the root, and those of every rival below `rivals`.

    Parameters
    ----------
    rows
        What was observed, m rows.
    rivals
        At least one; the first is the explanation that the answer rests on.
    described
        Attributes of the root.
    """
    groups = {}
    for number, rival in enumerate(rivals):
        for name, dataset in _list_groups(rows, rival).items():
            groups[f"{RIVALS}/{name_rival(rival)}/{name}"] = dataset
            if number == 0:
                groups[name] = dataset
    tree: xarray.DataTree = require("xarray").DataTree.from_dict(groups)
    tree.attrs.update(described)
    for rival in rivals:
        attributes = {
            "effects": list(rival.rival.ids),
            "probability": rival.rival.probability,
            "log_evidence": rival.rival.log_evidence,
            "model_error": rival.rival.model_error,
        }
        tree[f"{RIVALS}/{name_rival(rival)}"].attrs.update(attributes)
    return tree


def name_rival(rival: RivalDraws) -> str:
    """Its effects in one word."""
    return " with ".join(rival.rival.ids) or NOTHING


def _list_groups(rows: Observations, rival: RivalDraws) -> dict[str, "xarray.Dataset"]:
    return {
        "posterior": _make_values(rival.posterior, rival.units),
        "prior": _make_values(rival.prior, rival.units),
        "posterior_predictive": _make_rows(rows, _in_chains(rival.posterior_predictive)),
        "held_out_predictive": _make_rows(rows, _in_chains(rival.held_out_predictive)),
        "log_likelihood": _make_log_likelihood(rows, rival),
        "observed_data": _make_rows(rows, rows.measured),
        "constant_data": _make_rows(rows, rows.noise, "_noise_std"),
    }


def _in_chains(draws: Floats) -> Floats:
    """Draws (d, ...) as (chain, draw, ...)."""
    return draws.reshape(CHAINS, -1, *draws.shape[1:])


def _make_values(values: Mapping[str, Floats], units: Mapping[str, str]) -> "xarray.Dataset":
    variables = {}
    for name, draws in values.items():
        attributes = {"units": units[name]} if units.get(name) else {}
        variables[name] = (("chain", "draw"), _in_chains(draws), attributes)
    dataset: xarray.Dataset = require("xarray").Dataset(variables)
    return dataset


def _make_log_likelihood(rows: Observations, rival: RivalDraws) -> "xarray.Dataset":
    values = _in_chains(rival.log_likelihood)
    dataset: xarray.Dataset = require("xarray").Dataset(
        {"condition_given_others": (("chain", "draw", "condition"), values)},
        coords={"condition": list(rows.names())},
    )
    return dataset


def _make_rows(rows: Observations, values: Floats, ending: str = "") -> "xarray.Dataset":
    """A variable for each signal of values (..., m), with condition, phase and time of its rows.
    Its name is that of the signal with this ending.
    """
    names = np.array(rows.names())[rows.condition]
    leading = ("chain", "draw")[: values.ndim - 1]
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    for signal in dict.fromkeys(rows.signal):
        of_signal = rows.signal == signal
        row = f"{signal}_row"
        attributes = {"units": unit_of(signal)}
        variables[f"{signal}{ending}"] = ((*leading, row), values[..., of_signal], attributes)
        coordinates[f"{signal}_condition"] = (row, names[of_signal])
        coordinates[f"{signal}_phase"] = (row, rows.phase[of_signal])
        coordinates[f"{signal}_t_s"] = (row, rows.t_s[of_signal])
    dataset: xarray.Dataset = require("xarray").Dataset(variables, coords=coordinates)
    return dataset

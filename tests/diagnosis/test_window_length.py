"""How long windows may be: they double while starts are known and fits converge."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.diagnosis import window_length
from rfca_rig.diagnosis.data import Label
from rfca_rig.diagnosis.window_length import (
    LONGEST_S,
    WindowErrors,
    _double_lengths,
    lengthen_windows,
    measure_window_errors,
    shorten_windows,
)
from rfca_rig.errors import BadInput, SimulationFailed

SMALL = WindowErrors(start=0.01, misfit=0.01)


@dataclass(frozen=True)
class Cut:
    """Recordings of these durations in windows of these lengths; every recording is used."""

    recordings: tuple[str, ...]
    recordings_s: tuple[float, ...]
    lengths_s: tuple[float, ...]

    def cut_again(self, lengths_s):
        return Cut(self.recordings, self.recordings_s, tuple(lengths_s))

    @property
    def dataset(self):
        return SimpleNamespace(
            rows=SimpleNamespace(
                labels=[SimpleNamespace(recording=name) for name in self.recordings]
            )
        )


def lengthen(monkeypatch, recordings_s, errors_of, refuses=lambda _: False):
    """Lengths and fits at the end, if windows of a length have these errors in each recording,
    and some cannot be cut.
    """
    names = tuple("abcdef"[: len(recordings_s)])
    problem = Cut(names, recordings_s, (0.5,) * len(names))
    found = SimpleNamespace(nothing=SimpleNamespace(fitted="of 0.5 s"), named=())
    begun = []

    def cut_and_fit(problem, lengths_s, fits):
        begun.append(tuple(fits))
        if refuses(lengths_s):
            return None
        longest_s = max(lengths_s)
        return Cut(problem.recordings, problem.recordings_s, tuple(lengths_s)), (
            f"of {longest_s:g} s",
        )

    monkeypatch.setattr(window_length, "_cut_and_fit", cut_and_fit)
    monkeypatch.setattr(
        window_length,
        "measure_window_errors",
        lambda longer, _: {
            name: errors_of(name, s) for name, s in zip(names, longer.lengths_s, strict=True)
        },
    )
    longer, fits = lengthen_windows(problem, found)
    return longer.lengths_s, fits, begun


def test_lengths_double_up_to_the_longest_and_divide_a_recording_evenly(monkeypatch):
    lengths_s, fits, begun = lengthen(monkeypatch, (8.0, 8.6), lambda *_: SMALL)
    assert lengths_s == pytest.approx((LONGEST_S, 8.6 / 5))
    assert fits == ("of 2 s",)
    # every fit on longer windows begins where that on the shorter ones ended
    assert begun == [("of 0.5 s",), ("of 1 s",)]


@pytest.mark.parametrize(
    "errors", [WindowErrors(start=0.3, misfit=0.0), WindowErrors(start=0.0, misfit=0.6)]
)
def test_a_recording_keeps_the_windows_up_to_which_its_start_and_its_fit_are_good_enough(
    monkeypatch, errors
):
    lengths_s, _, _ = lengthen(
        monkeypatch, (8.0, 8.0), lambda name, s: errors if name == "b" and s > 1.0 else SMALL
    )
    assert lengths_s == pytest.approx((2.0, 1.0))


def test_the_short_windows_stay_where_no_recording_may_have_longer_ones(monkeypatch):
    lengths_s, fits, _ = lengthen(
        monkeypatch, (8.0, 8.0), lambda *_: WindowErrors(start=0.0, misfit=0.9)
    )
    assert lengths_s == (0.5, 0.5) and fits == ()


def test_windows_that_leave_too_few_conditions_or_cannot_be_simulated_are_not_used(monkeypatch):
    lengths_s, fits, _ = lengthen(
        monkeypatch, (8.0,), lambda *_: SMALL, refuses=lambda lengths_s: max(lengths_s) > 1.5
    )
    assert lengths_s == (1.0,) and fits == ("of 1 s",)


def test_a_recording_that_is_hardly_longer_than_a_window_is_not_cut_again():
    assert _double_lengths(Cut(("a", "b"), (0.55, 0.9), (0.5, 0.5)), {0, 1}) == pytest.approx(
        [0.5, 0.9]
    )


@pytest.mark.parametrize(
    ("allowed_s", "expected_s"),
    [(0.6, 0.5), (0.3, 0.25), (0.1, 0.25)],
    ids=["long", "half", "no shorter"],
)
def test_windows_are_halved_where_errors_of_the_start_are_too_large(
    monkeypatch, allowed_s, expected_s
):
    def errors(problem):
        return {"a": 0.01, "b": 0.2 if problem.lengths_s[1] <= allowed_s else 0.5}

    monkeypatch.setattr(window_length, "measure_start_errors", errors)
    assert shorten_windows(Cut(("a", "b"), (8.0, 8.0), (0.5, 0.5))).lengths_s == (0.5, expected_s)


def test_errors_are_shares_of_what_the_signals_change_over_all_recordings():
    """Two recordings of two signals; the second recording stands still."""
    labels = tuple(
        Label("swings", name, signal, recording=name)
        for name in ("moves", "rests")
        for signal in ("q_rad", "w_rad_s")
    )
    label = np.repeat(np.arange(4), 50)
    swing = np.sin(np.linspace(0.0, 20.0, 50))
    measured = np.concatenate([swing, 5.0 * swing, np.zeros(50), np.zeros(50)])
    rows = SimpleNamespace(
        measured=measured,
        labels=labels,
        label=label,
        signal=np.array([one.signal for one in labels])[label],
    )
    change = np.array([np.std(measured[rows.signal == signal]) for signal in ("q_rad", "w_rad_s")])[
        np.array([0, 1, 0, 1])[label]
    ]
    problem = SimpleNamespace(dataset=SimpleNamespace(rows=rows), start_std=0.1 * change)
    missed = np.where(label < 2, 0.2, 0.4) * change
    errors = measure_window_errors(problem, SimpleNamespace(predicted=measured - missed))
    assert (errors["moves"].start, errors["moves"].misfit) == pytest.approx((0.1, 0.2))
    assert (errors["rests"].start, errors["rests"].misfit) == pytest.approx((0.1, 0.4))


@pytest.mark.parametrize("failure", ["simulation", "no window", "few conditions", "few rows"])
def test_longer_windows_that_cannot_be_used_are_not_taken(failure):
    """For example where every longer window spans a gap of the recording."""

    def dataset(parts, rows):
        return SimpleNamespace(parts=range(parts), rows=SimpleNamespace(measured=np.zeros(rows)))

    def cut_again(lengths_s):
        if failure == "simulation":
            raise SimulationFailed("diverges")
        if failure == "no window":
            raise BadInput("every window has a gap")
        return SimpleNamespace(
            dataset=dataset(3, 100) if failure == "few conditions" else dataset(4, 70)
        )

    problem = SimpleNamespace(dataset=dataset(8, 100), cut_again=cut_again)
    assert window_length._cut_and_fit(problem, [1.0], ()) is None

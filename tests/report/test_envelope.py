import numpy as np

from rfca_rig.reports.style import envelope


def test_peaks_and_order_survive_and_points_are_few():
    x = np.linspace(0.0, 1.0, 15000)
    y = np.random.default_rng(0).normal(size=15000)
    y[7321] = 90.0
    y[7322] = -80.0
    thin_x, thin_y = envelope(x, y, 300)
    assert len(thin_x) <= 600
    assert (thin_y.max(), thin_y.min()) == (90.0, -80.0)
    assert np.all(np.diff(thin_x) > 0)
    assert set(thin_x) <= set(x)


def test_every_column_keeps_its_extremes():
    x = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 5000))
    y = np.sin(40.0 * x)
    thin_x, thin_y = envelope(x, y, 50)
    column, thin_column = (
        np.minimum((each - x[0]) / (x[-1] - x[0]) * 50, 49).astype(int) for each in (x, thin_x)
    )
    for number in range(50):
        assert thin_y[thin_column == number].max() == y[column == number].max()
        assert thin_y[thin_column == number].min() == y[column == number].min()


def test_a_short_line_is_left_alone():
    x = np.arange(5.0)
    assert envelope(x, x, 10)[0] is x

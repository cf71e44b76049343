"""The SVG curves: well-formed, inside their frame, with round ticks and without lost spikes."""

import re
import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.report.curves import _abscissas
from mi_dogsplat.report.plot import WIDTH, Lane, Series, line_plot
from mi_dogsplat.report.smoothing import MAX_POINTS, running_mean, thinned
from mi_dogsplat.report.ticks import log_ticks, nice_ticks, number, numbers


def test_a_plot_is_well_formed_and_stays_inside_its_view_box():
    x = np.linspace(0, 7000, 300)
    y = 0.2 * np.exp(-x / 900) + 0.01
    svg = line_plot(
        [Series("a < b", x, y, "faint"), Series("points", x[::50], y[::50], "points", 2)],
        "step",
        "L1",
        log_y=True,
        lanes=[Lane("densify", x[10:50])],
    )
    root = ElementTree.fromstring(svg)
    height = float(root.attrib["viewBox"].split()[3])
    points = [tuple(map(float, p)) for p in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", svg)]
    assert len(points) > 300
    assert all(0 <= px <= WIDTH and 0 <= py <= height for px, py in points)


def test_values_that_cannot_be_drawn_are_left_out():
    x = np.arange(5.0)
    svg = line_plot([Series("", x, np.array([1.0, np.nan, 0.0, np.inf, 2.0]))], "x", "y", log_y=True)
    curve = re.search(r'class="c1 line" d="([^"]*)"', svg)
    assert curve is not None and curve[1].count("L") == 1
    with pytest.raises(ValueError, match="no finite value"):
        line_plot([Series("", x, np.full(5, np.nan))], "x", "y")


@pytest.mark.parametrize("values", [[3.0], [0.0, 0.0], [5.0, 5.0]])
def test_a_constant_curve_has_a_plot_too(values):
    y = np.array(values)
    ElementTree.fromstring(line_plot([Series("", np.zeros(len(y)), y)], "x", "y"))


@pytest.mark.parametrize(("low", "high"), [(0, 7000), (21.3, 27.4), (0, 1e-5), (0.3, 3.1e6), (-4, 5)])
def test_ticks_are_round_and_neither_few_nor_many(low, high):
    ticks = nice_ticks(low, high, 5)
    assert 2 <= len(ticks) <= 6
    assert min(ticks) >= low - 1e-9 * (high - low) and max(ticks) <= high + 1e-9 * (high - low)
    mantissa = float(f"{ticks[1] - ticks[0]:e}".split("e")[0])
    assert round(mantissa, 6) in (1, 2, 5)


@pytest.mark.parametrize(("low", "high"), [(0.02, 0.25), (1e-6, 10), (0.03, 0.033), (0.9, 1.1)])
def test_log_ticks_lie_inside_and_neither_few_nor_many(low, high):
    ticks = log_ticks(low, high)
    assert 3 <= len(ticks) <= 8
    assert min(ticks) >= low * (1 - 1e-9) and max(ticks) <= high * (1 + 1e-9)


def test_numbers_on_the_axes_are_short():
    values = (0, 0.02, 1500, 20000, 2.5e6, -3)
    assert [number(v) for v in values] == ["0", "0.02", "1.5k", "20k", "2.5M", "\u22123"]


@pytest.mark.parametrize(("low", "high"), [(27.691, 27.699), (27.6951, 27.6958), (5_038_210, 5_038_290), (0, 7000)])
def test_numbers_on_an_axis_say_where_its_ticks_are_however_near_to_each_other(low, high):
    ticks = nice_ticks(low, high, 5)
    values = [float(words.replace("k", "e3").replace("M", "e6")) for words in numbers(ticks)]
    np.testing.assert_allclose(values, ticks, atol=0.011 * (ticks[1] - ticks[0]))


@pytest.mark.parametrize(("longest", "unit", "last"), [(100.0, "s", 100.0), (600.0, "min", 10.0), (14_400.0, "h", 4.0)])
def test_run_times_are_in_the_unit_that_their_axis_names(longest, unit, last):
    columns = {"seconds": np.array([0, longest]), "step": np.array([0.0, 30])}
    run: Any = SimpleNamespace(column=columns.__getitem__)
    (label, times), (step, steps) = _abscissas(run)
    assert (label, step, times.tolist(), steps.tolist()) == (f"run time, {unit}", "step", [0, last], [0, 30])


def test_thinning_keeps_spikes_and_order():
    x, y = np.arange(30000.0), np.ones(30000)
    y[12345], y[23456] = 9, -9
    thin_x, thin_y = thinned(x, y)
    assert len(thin_x) <= MAX_POINTS and np.all(np.diff(thin_x) > 0)
    assert thin_y.max() == 9 and thin_y.min() == -9


@pytest.mark.parametrize(("n", "rows"), [(39, 1), (40, 3), (159, 3), (160, 5), (400, 11)])
def test_a_running_mean_is_over_an_odd_fortieth_of_the_rows_around_each_without_gaps(n, rows):
    y = np.random.default_rng(0).normal(size=n)
    y[[7, 20, 21, 22]] = np.nan
    found, spanned = running_mean(y)
    around = [y[max(0, i - rows // 2) : i + rows // 2 + 1] for i in range(n)]
    expected = [np.nanmean(part) if np.isfinite(part).any() else 0 for part in around]
    assert spanned == rows
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_gap_at_the_end_still_belongs_to_the_axis():
    x, y = np.array([0.0, 50.0, 100.0]), np.array([1.0, 2.0, np.nan])
    assert ">100</text>" in line_plot([Series("", x, y)], "step", "PSNR")

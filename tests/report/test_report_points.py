"""Named points in a plot: on logarithmic axes, with tooltips, rings and words that cover nothing."""

import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from html_pages import parsed, words
from mi_dogsplat.report.page import TEMPLATES
from mi_dogsplat.report.plot import LEFT, RIGHT, WIDTH, Series, line_plot
from mi_dogsplat.report.points import CHARACTER, CLEAR, RING, Label, Note, _candidates, labels
from mi_dogsplat.report.ticks import number

X, Y = np.array([1.0, 10.0, 100.0]), np.array([1e-2, 1e-4, 1e-6])
NOTES = [Note("a: 0.01", "a"), Note("b < c"), Note("d", "<d>")]


def places(svg: str) -> list[tuple[float, float]]:
    found = re.findall(r'class="c1 points" transform="translate\(([\d.]+) ([\d.]+)', svg)
    return [(float(x), float(y)) for x, y in found]


def test_equal_ratios_are_equal_distances_on_two_logarithmic_axes():
    svg = line_plot([Series("", X, Y, "points", notes=NOTES)], "ms", "error", log_x=True, log_y=True)
    ElementTree.fromstring(svg)
    (x0, y0), (x1, y1), (x2, y2) = places(svg)
    assert x1 - x0 == pytest.approx(x2 - x1, abs=0.2) and y1 - y0 == pytest.approx(y2 - y1, abs=0.2)
    assert LEFT < x0 < x1 < x2 < WIDTH - RIGHT and y0 < y1 < y2
    for tick in ("1", "10", "100", "0.01", "1e\u22125"):
        assert f">{tick}</text>" in svg


def test_what_a_logarithmic_axis_cannot_show_takes_its_note_along():
    x = np.array([0.0, 1.0, 10.0])
    svg = line_plot([Series("", x, Y, "points", notes=NOTES)], "ms", "error", log_x=True)
    assert "<title>a: 0.01</title>" not in svg and "<title>b &lt; c</title>" in svg
    assert len(places(svg)) == 2 and svg.count('class="ring"') == 1


def test_notes_with_a_label_have_a_ring_and_the_words_beside_it():
    svg = line_plot([Series("", X, Y, "points", notes=NOTES)], "ms", "error", log_x=True, log_y=True)
    assert svg.count('class="ring"') == 2 and re.findall(r'class="note"[^>]*>([^<]*)<', svg) == ["a", "&lt;d&gt;"]


def test_words_stay_inside_and_cover_neither_points_nor_each_other():
    rng = np.random.default_rng(0)
    points = [(float(x), float(y)) for x, y in rng.uniform(20, 280, (40, 2))]
    notes = [Note("", f"label {i}") for i in range(40)]
    boxes = []
    for label in labels(points, notes, (0, 0, 300, 300)):
        x, y, width = label.x, label.y, len(label.words) * CHARACTER
        left = x - width * {"start": 0, "middle": 0.5, "end": 1}[label.anchor]
        boxes.append((left, y - 10, left + width, y + 3))
    assert 5 < len(boxes) < 40  # some fit, some do not
    for i, (left, top, right, bottom) in enumerate(boxes):
        assert left >= 0 and top >= 0 and right <= 300.1 and bottom <= 300.1
        for x, y in points:  # all have a ring
            assert left > x + RING - 0.1 or x - RING > right - 0.1 or top > y + RING - 0.1 or y - RING > bottom - 0.1
        for box in boxes[:i]:  # coordinates are rounded to a tenth
            apart = left > box[2] - 0.1 or box[0] > right - 0.1 or top > box[3] - 0.1 or box[1] > bottom - 0.1
            assert apart, (boxes[i], box)


def test_a_label_without_room_on_the_right_goes_to_the_left():
    (found,) = labels([(95.0, 50.0)], [Note("", "words")], (0, 0, 100, 100))
    assert found == Label("words", "end", 95 - CLEAR, found.y)


def test_words_leave_the_curves_free():
    """Those of a comparison become flat to the right border, where each ends: the words lay on them."""
    x = np.linspace(60, 400, 9)
    lines = [list(zip(x.tolist(), (40 + 40 * k + 0.002 * (400 - x) ** 2).tolist(), strict=True)) for k in range(4)]
    points, notes = [line[-1] for line in lines], [Note("", f"words {k}") for k in range(4)]
    found = labels(points, notes, (0, 0, 420, 400), lines)
    assert [label.words for label in found] == [note.label for note in notes]
    along = np.linspace(0, 1, 500)[:, None]
    drawn = np.concatenate([a + along * (b - a) for line in lines for a, b in pairwise(np.array(line))])
    for left, top, right, bottom in (label.box for label in found):
        assert not ((drawn > (left, top)) & (drawn < (right, bottom))).all(axis=1).any()


def test_the_outermost_points_have_room_for_words_above_and_below():
    x, levels = np.array([0.0, 1.0]), {"best": 1.0, "worst": 0.0}
    curves = [Series("", x, np.array([1.0, y])) for y in levels.values()]  # in the way of words to the left
    ends = [Series("", x[1:], np.array([y]), "points", notes=[Note("", name)]) for name, y in levels.items()]
    svg = line_plot([*curves, *ends], "s", "PSNR", legend=False)
    (best, worst), words_at = places(svg), re.findall(r'class="note"[^>]* y="([\d.]+)">(\w+)<', svg)
    assert [name for _, name in words_at] == list(levels)
    assert float(words_at[0][0]) < best[1] - RING and float(words_at[1][0]) > worst[1] + RING


def test_words_that_every_place_has_lie_on_the_fewest_curves():
    around = [[(0.0, y), (100.0, y)] for y in range(0, 100, 7)]
    (found,) = labels([(50.0, 50.0)], [Note("", "word")], (0, 0, 100, 100), around)
    crossed = [sum(label.box[1] < y < label.box[3] for ((_, y), _) in around) for label in _candidates("word", 50, 50)]
    assert sum(found.box[1] < y < found.box[3] for ((_, y), _) in around) == min(crossed)


def test_every_colour_has_a_shape_of_its_own_in_plots_and_in_legends():
    notes = [Note("a < b", "a")]
    svg = line_plot([Series("", X[:1], Y[:1], "points", c, notes) for c in range(8)], "ms", "error", log_y=True)
    shapes = re.findall(r'class="c(\d) points" transform="[^"]*" d="([^"]*)"><title>a &lt; b</title>', svg)
    assert [int(color) for color, _ in shapes] == list(range(8)) and len({shape for _, shape in shapes}) == 8
    parts: Any = TEMPLATES.get_template("report/templates/parts.html").module
    entries = list(parsed(parts.legend([("a < b", 1), ("c", 7)])).iter("li"))
    assert [words(entry) for entry in entries] == ["a < b", "c"]
    for entry, color in zip(entries, (1, 7), strict=True):
        drawn = entry.find(".//path")
        assert drawn is not None and drawn.attrib["class"] == f"c{color} points"
        assert drawn.attrib["d"] == shapes[color][1]


def test_numbers_far_from_one_are_short_too():
    assert [number(v) for v in (1e-7, 2.5e-5, 4.74e18, -2e9)] == ["1e\u22127", "2.5e\u22125", "4.74e18", "\u22122e9"]

"""The page of ``dogsplat check``: its parts, plots and tables."""

import re
import xml.etree.ElementTree as ElementTree
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from check_report import REPORT, figures, row
from html_pages import parsed, rows, section, words
from mi_dogsplat.check.page import check_page
from mi_dogsplat.check.tables import cell, table
from mi_dogsplat.report.page import TEMPLATES


def page_of(report: dict) -> Element:
    return parsed(check_page(report))


def table_of(values: list[dict]) -> Element:
    """The table of a page."""
    macros: Any = TEMPLATES.get_template("check/templates/table.html").module
    return parsed(macros.table(table(values)))


# --- the page ---


def test_the_page_is_well_formed_and_needs_nothing_but_itself():
    html = check_page(REPORT)
    parsed(html)
    svgs = re.findall(r"<svg.*?</svg>", html, re.DOTALL)
    assert len(svgs) == 5 + 5  # and the swatches of the legends
    for svg in svgs:
        ElementTree.fromstring(svg)
    for word in ("<script", "<link", "http", "url(", "NaN", "None"):
        assert word not in html


def test_the_page_shows_every_part():
    html = check_page(REPORT)
    assert "<title>fox &amp; friends.ply · check</title>" in html
    page = parsed(html)
    headings = ["Error against run time", "Training error against run time", "Stability"]
    assert [words(heading) for heading in page.iter("h2")] == headings
    for heading in headings:
        part = section(page, heading)
        assert part is not None and part[0].attrib["class"] == "read"
    labels = [re.findall('aria-label="([^"]*)"', svg)[0] for svg in figures(html)]
    assert labels == [
        "mean error of the image against forward, ms", "relative error, worst gradient against forward + backward, ms",
        "training L1 against run time, s", "PSNR, dB against run time, s", "FLIP against run time, s",
    ]  # fmt: skip
    tiles = [words(tile) for tile in page.findall(".//*[@class='tile']")]
    assert tiles == [
        "Image error ↓ 0.001 mean, defaults, a < b", "Its rounding ↓ 1.0e−7 float32 against float64",
        "Gradient error ↓ 0.002 relative, the worst parameter", "Forward 5.0 ms 15.0 with backward",
        "Stability 2 cases 0 of them defined, 1 wrong", "Training 2 runs error against wall-clock time",
    ]  # fmt: skip
    (facts,) = page.findall(".//dl")
    assert [words(fact) for fact in facts] == ["variantllvm_ad_rgb", "cores2", "load0.1"]


def test_text_from_files_cannot_become_markup():
    html = check_page(REPORT)
    for text in ("fox &amp; friends", "a &lt; b", "&lt;3dgs&gt;", "a &lt;defect&gt;"):
        assert text in html
    assert "<3dgs>" not in html and "<defect>" not in html


def test_parts_that_were_not_run_are_left_out():
    for key in ("work_precision", "training", "stability"):
        page = page_of({"model_name": None, "machine": {}, key: REPORT[key]})
        assert len(list(page.iter("h2"))) == 1
        assert words(next(page.iter("h1"))) == "numerics check"
    assert not list(page_of({}).iter("h2"))


def test_the_front_is_ringed_named_and_joined_and_the_default_drawn_once():
    (image,) = figures(check_page(REPORT), "mean error")
    assert image.count('class="ring"') == 3  # default, no cutoffs, 1/64
    assert sorted(re.findall(r'class="note"[^>]*>([^<]*)<', image)) == ["1/64", "default", "no cutoffs"]
    assert image.count('class="c0 dashed"') == 1 and image.count('class="c0 points"') == 2
    assert "<title>alpha cutoff 1/64: 0.004, 4 ms</title>" in image
    (gradient,) = figures(check_page(REPORT), "relative error")
    assert gradient.count('class="ring"') == 1


def test_both_axes_of_the_settings_are_logarithmic():
    rows = [row("bound", str(ms), ms, 1 / ms**2) for ms in (1.0, 10.0, 100.0)]
    scene = REPORT["work_precision"][0]
    html = check_page({"work_precision": [scene | {"rows": [scene["rows"][0], *rows]}]})
    for svg in figures(html)[:2]:
        points = re.findall(r'class="c3 points" transform="translate\(([\d.]+) ([\d.]+)', svg)
        for a, b, c in zip(*np.array(points, float), strict=True):
            assert b - a == pytest.approx(c - b, abs=0.2) and abs(b - a) > 20


def test_the_table_of_a_scene_has_every_setting_and_parameter():
    (numbers,) = page_of(REPORT).iter("details")
    head, *body = rows(numbers)
    assert {"setting", "means", "quats"} <= set(head) and ["alpha cutoff"] in body
    assert [line[0] for line in body if len(line) > 1] == [
        "default", "no cutoffs", "1/64", "1/255 (default)", "16", "1 (default)"
    ]  # fmt: skip
    assert body[1][-1] == "image, gradient"


def test_an_error_of_zero_or_unknown_is_in_the_table_but_not_on_the_logarithmic_plot():
    odd = row("bound", "4", 5.0, 0.0), row("bound", "2", 5.0, 1e-3, mean_error=None, psnr=None)
    scene = REPORT["work_precision"][0]
    html = check_page({"work_precision": [scene | {"rows": [*scene["rows"], *odd]}]})
    (image,) = figures(html, "mean error")
    assert "bound 16:" in image and "bound 4:" not in image and "bound 2:" not in image
    assert {"4", "2"} <= {line[0] for line in rows(next(parsed(html).iter("details")))}


def test_a_busy_machine_is_said_to_be_one():
    assert not page_of(REPORT).findall(".//*[@class='notice']")
    (notice,) = page_of(REPORT | {"machine": {"load": 1.5}}).findall(".//*[@class='notice']")
    assert "Repeat it on a quiet machine." in words(notice)


# --- tables ---


def test_a_table_takes_whatever_columns_come():
    found = rows(table_of([{"a_b": 1, "c": "x"}, {"a_b": None, "d": True}]))
    assert found == [["a b", "c", "d"], ["1", "x", "–"], ["–", "–", "yes"]]
    assert table([]).groups == []


def test_rows_of_a_group_stand_under_its_name_once():
    found = table_of([{"group": g, "v": i} for i, g in enumerate("aab")])
    assert rows(found) == [["v"], ["a"], ["0"], ["1"], ["b"], ["2"]]
    names = [line for line in found.iter("tr") if line.get("class") == "group"]
    assert [(words(name), name[0].attrib["colspan"]) for name in names] == [("a", "1"), ("b", "1")]


def test_numbers_stand_to_the_right_and_defects_stand_out():
    found = table_of([{"n": 1.0, "verdict": "right", "finite": True}, {"n": None, "verdict": "wrong", "finite": False}])
    classes = [[(words(cell), cell.get("class")) for cell in line] for line in found.iter("tr")]
    assert classes == [
        [("n", "n"), ("verdict", None), ("finite", None)],
        [("1", "n"), ("right", None), ("yes", None)],
        [("–", "n"), ("wrong", "bad"), ("no", "bad")],
    ]


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (1.234e-7, "1.2e\u22127"), (0.0123, "0.0123"), (0.0, "0"), (4.74e18, "4.74e18"), (-2.0, "\u22122"),
        (3000, "3,000"), (float("nan"), "–"), (None, "–"), (False, "no"), ("<b>", "<b>"), ([1, 2.5], "1, 2.5"),
        (list("abcdef"), "6 values"), (1e-15, "1.0e\u221215"),
        ({"means": 1e-6, "quats": 2e-3, "x": None}, ("0.002", "quats")), ({}, "–"), (0, "0"),
    ],
)  # fmt: skip
def test_values_are_shown_short(value, shown):
    assert cell(value)[:2] == (shown if isinstance(shown, tuple) else (shown, ""))

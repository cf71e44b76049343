"""The mixture in a report: pictures, the marked row, the profile."""

import json
import re
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from html_pages import parsed, section, words
from mi_dogsplat.report.run_folder import DOG_PROFILE
from mi_dogsplat.report.write import write_report
from mi_dogsplat.support import pictures
from mi_dogsplat.support.errors import DataError

HEIGHT, WIDTH = 40, 64
ENDS = ("", "_gt", "_error", "_gaussian", "_dog", "_plain", "_plain_error")
HEADING = "With and without DoG"


@pytest.fixture
def run(tmp_path):
    """A run folder with three test views, the middle one compared; the error differs from pixel 40 to 48."""
    rng = np.random.default_rng(0)
    for end in ENDS:
        pictures.write_png(tmp_path / "test" / f"b{end}.png", rng.random((HEIGHT, WIDTH, 3)))
    views = {name: {"psnr": psnr} for name, psnr in (("a", 20), ("b", 25), ("c", 30))}
    (tmp_path / "metrics.json").write_text(json.dumps({"n": 5000, "n_dog": 1200, "views": views}))
    with_dog, without = np.full(WIDTH, 0.05), np.full(WIDTH, 0.05)
    without[40:48] = 0.4
    profile = {
        "view": "b",
        "without": "the <other> model",
        "row": 10,
        "with_dog": {"metrics": {"psnr": 25.5, "flip": 0.11}, "error": with_dog.tolist()},
        "without_dog": {"metrics": {"psnr": 24.25, "flip": 0.12}, "error": without.tolist()},
    }
    (tmp_path / "test" / DOG_PROFILE).write_text(json.dumps(profile))
    return tmp_path


def mixture(run) -> Element:
    found = section(parsed(write_report(run).read_text()), HEADING)
    assert found is not None
    return found


def frames(run) -> list[list[dict[str, float]]]:
    """Of each picture: what is drawn over it, its sides in percent."""
    pictures = mixture(run).findall(".//*[@class='frame']")
    styles = [[mark.attrib["style"] for mark in picture.iter("b")] for picture in pictures]
    return [[{k: float(v) for k, v in re.findall(r"(\w+):([-\d.]+)%", style)} for style in of] for of in styles]


def test_the_parts_and_both_errors_stand_in_the_report(run):
    found = mixture(run)
    assert [words(caption) for caption in found.iter("figcaption")] == [
        "Render",
        "The 3,800 plain Gaussians only",
        "The 1,200 DoG only",
        "Render without DoG",
        "FLIP error with DoG",
        "FLIP error without DoG",
    ]
    sources = [image.attrib["src"] for image in found.iter("img")]
    assert len(sources) == 6 and all(source.startswith("data:image/jpeg;base64,") for source in sources)


def test_the_view_is_named_with_its_place_and_both_metrics(run):
    found = mixture(run)
    assert [words(heading) for heading in found.iter("h3")] == ["b, median view"]
    text = words(found)
    assert "with DoG: PSNR 25.50 dB, FLIP 0.1100 without: PSNR 24.25 dB, FLIP 0.1200" in text
    assert "Without DoG: the <other> model." in text


def test_the_row_is_drawn_in_every_picture_and_its_most_different_quarter_framed(run):
    assert len(frames(run)) == 6
    for row, quarter in frames(run):
        assert row == {"left": 0, "top": round(100 * 10.5 / HEIGHT, 2), "width": 100, "height": 0}
        assert quarter["width"] == 25 and quarter["left"] <= 100 * 40 / WIDTH and quarter["left"] + 25 >= 4800 / WIDTH
        assert quarter["top"] < row["top"] < quarter["top"] + quarter["height"]


@pytest.mark.parametrize("row", [0, HEIGHT - 1])
def test_the_frame_of_an_outermost_row_stays_inside_the_picture(run, row):
    profile = json.loads((run / "test" / DOG_PROFILE).read_text()) | {"row": row}
    (run / "test" / DOG_PROFILE).write_text(json.dumps(profile))
    for _, quarter in frames(run):
        assert quarter["top"] >= 0 and quarter["top"] + quarter["height"] <= 100


def test_the_profile_is_drawn_whole_and_close_up(run):
    plots = re.findall(r"<svg.*?</svg>", write_report(run).read_text(), re.DOTALL)
    assert len(plots) == 2
    for plot, points in zip(plots, (WIDTH, WIDTH // 4), strict=True):
        curves = re.findall(r'class="c[12] line" d="([^"]*)"', plot)
        assert [curve.count("L") + 1 for curve in curves] == [points, points]
        assert ">with DoG</tspan>" in plot and ">without</tspan>" in plot and "pixel of row 10" in plot
        heights = {point.split(" ")[1] for point in curves[1][1:].split("L")}
        assert len(heights) == 2  # where the two differ is in both plots
    assert ">0</text>" in plots[0] and ">40</text>" in plots[1] and ">20</text>" not in plots[1]


def test_a_run_that_compared_nothing_has_no_such_section(run):
    (run / "test" / DOG_PROFILE).unlink()
    assert section(parsed(write_report(run).read_text()), HEADING) is None


def test_a_missing_picture_is_named(run):
    (run / "test" / "b_dog.png").unlink()
    assert "Missing or not readable: b_dog.png." in words(mixture(run))
    assert len(list(mixture(run).iter("figure"))) == 5


def test_a_profile_that_is_not_json_is_named_in_one_line(run):
    (run / "test" / DOG_PROFILE).write_text("{")
    with pytest.raises(DataError, match=r"dog_profile.json: not valid JSON"):
        write_report(run)

"""The report of complete, partial and broken run folders."""

import base64
import io
import json
import re

import numpy as np
import pytest
from happenings import history_of
from html_pages import parsed, rows, section, words
from mi_dogsplat.report.pictures import embedded_jpeg, worst_box
from mi_dogsplat.report.views import ranked, sheet, shown
from mi_dogsplat.report.write import write_report
from mi_dogsplat.support import pictures
from mi_dogsplat.support.errors import DataError
from mi_dogsplat.training.events import (
    ROWS_ACTIVATED,
    ROWS_LEFT_OUT,
    Densified,
    DogActivated,
    Event,
    OpacityReset,
    Pruned,
    ShDegree,
    row_of,
)
from PIL import Image

VIEWS = {f"view{i}": {"psnr": 20.0 + i, "ssim": 0.5 + i / 20, "flip": 0.1, "l1": 0.02} for i in range(9)}

METRICS = {
    "test": {"psnr": 24.004, "ssim": 0.7005, "flip": 0.1001, "l1": 0.02},
    "train": {"psnr": 31.22, "ssim": 0.94, "flip": 0.07, "l1": 0.017},
    "n": 38294,
    "n_dog": 6604,
    "bytes": 9_170_000,
    "train_seconds": 302.4,
    "render_ms": 41.7,
    "peak_memory_mb": 1843,
    "steps": 700,
    "seed": 5,
    "variant": "llvm_ad_rgb",
    "versions": {"mitsuba": "3.9.1"},
    "views": VIEWS,
}


def write_history(run, rows: int = 70) -> None:
    events: dict[int, list[Event]] = {
        10: [Densified(1, 2, 3)], 20: [OpacityReset()], 30: [ShDegree(1)], 40: [Pruned(9, 5, "why not", 0.1)],
        50: [DogActivated(9)],
    }  # fmt: skip
    lines = []
    for i in range(rows):
        row = {
            "step": 10 * i + 10,
            "seconds": 4.3 * i,
            "l1": 0.2 / (i + 1),
            "n": 100 + i,
            "n_dog": 9 if i > 50 else 0,
        }
        words = {60: {"event": "moon rises"}}.get(i, {})  # of an older version
        lines.append(json.dumps(row | row_of(events.get(i, [])) | words))
    (run / "history.jsonl").write_text("\n".join(lines) + "\n")


@pytest.fixture
def run(tmp_path):
    """A complete run folder."""
    folder = tmp_path / "run"
    folder.mkdir()
    config = {"data": "/data/fox & friends/", "preset": "ours", "steps": 700, "densify": {"interval": 100}}
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "metrics.json").write_text(json.dumps(METRICS))
    write_history(folder)
    rng = np.random.default_rng(0)
    for name in VIEWS:
        for suffix in ("", "_gt", "_error"):
            pictures.write_png(folder / "test" / f"{name}{suffix}.png", rng.random((24, 32, 3)))
    return folder


def text_of(path) -> str:
    return path.read_text(encoding="utf-8")


def test_a_complete_run_shows_its_numbers_curves_and_pictures(run):
    html = text_of(write_report(run))
    assert "<title>fox &amp; friends \u00b7 preset ours</title>" in html
    for expected in (
        "24.00",
        "0.7005",
        "38,294",
        "6,604 of them DoG",
        "9.17",
        "5 min 02 s",
        "llvm_ad_rgb",
        "3.9.1",
    ):
        assert expected in html
    assert html.count("<svg") == 4  # error and count, against run time and step
    assert html.count("<img") == 6 * 5  # best, median, worst and two between, in full and close up
    assert "view8, best view" in html and "view4, median view" in html and "view0, worst view" in html
    page = parsed(html)
    settings = section(page, "Settings")
    assert settings is not None and ["densify.interval", "100"] in rows(settings)
    assert not page.findall(".//*[@class='notice']")


@pytest.mark.parametrize("split", ["test", "validation"])
def test_where_validation_views_come_from_is_told_for_data_that_have_some_and_that_have_none(run, split):
    config = json.loads((run / "config.json").read_text())
    (run / "config.json").write_text(json.dumps(config | {"split": split}))
    views = section(parsed(text_of(write_report(run))), f"{split.capitalize()} views")
    said = "They are the validation views of the data, or else every 8th training view: the test views were not read."
    assert views is not None and (said in " ".join(words(views).split())) == (split == "validation")


def test_the_table_of_views_has_all_of_them_best_first(run):
    views = section(parsed(text_of(write_report(run))), "Test views")
    assert views is not None
    head, *body = rows(views)
    assert head == ["view", "PSNR, dB", "", "SSIM", "FLIP", "L1", ""] and len(body) == 9
    assert body[0] == ["view8", "28.00", "", "0.9000", "0.1000", "0.0200", "best"] and body[-1][0] == "view0"
    bars = [bar.attrib["style"] for bar in views.findall(".//*[@class='bar']/i")]
    assert bars[0] == "width:100%" and bars[-1] == "width:15%"


def test_the_page_needs_nothing_but_itself(run):
    html = text_of(write_report(run))
    assert "<script" not in html and "<link" not in html and "http" not in html and "url(" not in html
    sources = [image.attrib["src"] for image in parsed(html).iter("img")]
    assert len(sources) == 30 and all(source.startswith("data:image/") for source in sources)


def test_every_kind_of_event_has_its_lane(run):
    html = text_of(write_report(run))
    for lane in ("densify", "reset", "SH up", "prune", "other"):
        assert html.count(f">{lane}</text>") == 2
    assert html.count(">DoG</text>") == 2 + 4  # and a mark in each plot


@pytest.mark.parametrize(
    ("lane", "rows", "counted", "words"),
    [
        ("slopes", "slopes", {"n_slopes": 5432}, "5,432 with slopes"),
        ("slopes", "curvatures", {"n_curvatures": 4}, "4 with curvatures"),
        ("slopes", "curvatures", {"n_slopes": 9, "n_curvatures": 8}, "9 with slopes, 8 with curvatures"),
        ("cuts", "cuts", {"n_cuts": 3210}, "3,210 with a cut"),
        ("cuts", "cuts", {"n_slopes": 9, "n_cuts": 8}, "9 with slopes, 8 with a cut"),
        ("cuts", "second_cuts", {"n_second_cuts": 3}, "3 with a second cut"),
        ("cuts", "second_cuts", {"n_cuts": 8, "n_second_cuts": 6}, "8 with a cut, 6 with a second cut"),
        ("shifts", "shifts", {"n_shifts": 5}, "5 with shifts"),
    ],
)
def test_rows_have_a_lane_and_are_counted_where_a_run_gives_them(run, lane, rows, counted, words):
    before = text_of(write_report(run))
    kinds = "slopes", "curvatures", "a cut", "shifts"
    assert f">{lane}</text>" not in before and not any(word in before for word in kinds)
    history = history_of(run)
    history[-1] |= row_of([ROWS_ACTIVATED[rows](7), ROWS_LEFT_OUT[rows](2, 5)])
    (run / "history.jsonl").write_text("".join(json.dumps(row) + "\n" for row in history))
    (run / "metrics.json").write_text(json.dumps(METRICS | counted))
    html = text_of(write_report(run))
    assert html.count(f">{lane}</text>") == 2 and f"6,604 of them DoG, {words}" in html


def test_test_psnr_is_drawn_where_the_history_has_it(run):
    history = history_of(run)
    history[20]["test_psnr"] = 19.0
    (run / "history.jsonl").write_text("\n".join(map(json.dumps, history)))
    html = text_of(write_report(run))
    assert html.count("<svg") == 6
    assert html.count("<title>24</title>") == 2  # the final value comes from metrics.json


def test_an_interrupted_run_says_so_and_how_far_it_came(run):
    (run / "metrics.json").unlink()
    (run / "history.jsonl").write_text(text_of(run / "history.jsonl") + '{"step": 710, "sec')
    page = parsed(text_of(write_report(run)))
    assert [words(notice) for notice in page.findall(".//*[@class='notice']")] == [
        "This run is not complete: there is no metrics.json. It was interrupted, or is still running. Last logged: "
        "step 700 of 700 after 4 min 57 s, training L1 0.0029, 169 primitives.",
        "Lines of history.jsonl that were left out because they are not JSON: 1.",
    ]
    assert len(list(page.iter("svg"))) == 4


def test_an_empty_folder_gives_a_report_that_names_all_that_is_missing(tmp_path):
    html = text_of(write_report(tmp_path))
    for expected in ("no metrics.json", "no config.json", "There are no curves", "There are no test views"):
        assert expected in html
    assert not list(parsed(html).iter("svg"))


def test_a_missing_picture_is_named(run):
    (run / "test" / "view8_error.png").unlink()
    (run / "test" / "view0.png").write_bytes(b"not a picture")
    page = parsed(text_of(write_report(run)))
    missing = [words(p) for p in page.iter("p") if words(p).startswith("Missing")]
    assert missing == [f"Missing or not readable: {name}." for name in ("view8_error.png", "view0.png")]


def test_values_that_are_not_finite_do_not_break_the_page(run):
    metrics = METRICS | {
        "test": {"psnr": float("nan"), "ssim": None},
        "views": {"view0": {"psnr": float("nan")}},
    }
    (run / "metrics.json").write_text(json.dumps(metrics))
    history = [{"step": 10 * i, "seconds": i, "l1": [0.1, float("nan"), 0.0][i % 3], "n": 5} for i in range(9)]
    (run / "history.jsonl").write_text("\n".join(map(json.dumps, history)))
    html = text_of(write_report(run))
    assert "nan" not in re.sub(r'base64,[^"]*', "", html).lower()


def test_bad_input_is_named_in_one_line(run, tmp_path):
    with pytest.raises(DataError, match=r"nowhere: no such folder; give a run folder"):
        write_report(tmp_path / "nowhere")
    (run / "metrics.json").write_text("{")
    with pytest.raises(DataError, match=r"metrics.json: not valid JSON"):
        write_report(run)
    (run / "metrics.json").write_text("[]")
    with pytest.raises(DataError, match=r"metrics.json: is not a JSON object"):
        write_report(run)


def test_text_from_the_run_cannot_become_markup(run):
    """Wherever a file of the run holds text."""
    evil = """'"><evil a='1'>&amp;<!--"""
    pictures.write_png(run / "test" / "a&<b>_gt.png", np.zeros((4, 4, 3)))
    config = {"data": evil, "preset": evil, "seed": evil, evil: evil, "steps": 70}
    views = {evil: {"psnr": 1.0, "ssim": evil}, "a&<b>": {"psnr": 2.0}}
    profile = {"view": evil, "without": evil, "row": evil, "with_dog": {"metrics": {"psnr": evil}}}
    row = {"step": evil, "seconds": 1, "l1": 0.1, "n": 5, "pruned_from": 9, "pruned_to": 5}
    row |= {"event": evil, "events": [{"kind": "pruned", "reason": evil}, {"kind": evil}, evil]}
    (run / "config.json").write_text(json.dumps(config))
    metrics = {"versions": {evil: evil}, "views": views, "variant": evil, "n": evil}
    (run / "metrics.json").write_text(json.dumps(metrics))
    (run / "history.jsonl").write_text(json.dumps(row))
    (run / "test" / "dog_profile.json").write_text(json.dumps(profile))
    page = parsed(text_of(write_report(run)))
    assert not list(page.iter("evil"))
    title, shown = page.find(".//title"), words(page)
    assert title is not None and title.text == f"{evil} \u00b7 preset {evil}"
    assert shown.count(evil) >= 12 and "a&<b>, best view" not in shown and "a&<b>" in shown
    captions = [image.attrib["alt"] for image in page.iter("img")]
    assert captions == ["Ground truth"]


def test_views_are_ranked_by_psnr_and_few_are_all_shown():
    views = ranked(VIEWS)
    assert [v.name for v in views] == [f"view{i}" for i in range(8, -1, -1)]
    assert [v.name for v in shown(views)] == ["view8", "view6", "view4", "view2", "view0"]
    assert len(shown(views[:6])) == 6
    assert [v.place for v in ranked({"a": {"psnr": 1.0}, "b": {}})] == ["", ""]
    assert ranked({"a": {"psnr": 1.0}, "b": {}})[0].title == "a"


def test_the_close_up_covers_the_largest_error():
    error = np.zeros((80, 120))
    error[50:60, 90:110] = 1
    left, top, width, height = worst_box(error)
    assert (width, height) == (30, 20)
    assert left <= 90 and left + width >= 110 and top <= 50 and top + height >= 60


def test_the_close_up_of_a_view_with_a_mask_covers_the_largest_error_of_what_counts(tmp_path):
    error, mask = np.zeros((80, 120, 3)), np.ones((80, 120))
    error[50:60, 90:110], error[5:15, 10:30] = 1, 0.5
    mask[40:] = 0
    for name, picture in (("a", error), ("a_gt", error), ("a_error", error)):
        pictures.write_png(tmp_path / f"{name}.png", picture)
    (view,) = ranked({"a": {}})
    (below,) = sheet(view, tmp_path).full[0].marks
    pictures.write_png(tmp_path / "a_mask.png", mask)
    (above,) = sheet(view, tmp_path).full[0].marks
    assert below["top"] > 45 and above["left"] < 10 and above["top"] < 10  # percent of the picture


def test_a_picture_that_is_noise_is_embedded_too():
    noise = np.random.default_rng(0).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    source = embedded_jpeg(Image.fromarray(noise))
    back = np.asarray(Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2]))))
    assert back.shape == noise.shape and np.abs(back.astype(int) - noise).mean() < 20

"""The same detail of a view by every method: which window that is, under masks too."""

import json

import numpy as np
import pytest
from mi_dogsplat.compare.crops import Crops, crops
from mi_dogsplat.support.pictures import write_png

ROWS = {name: {"label": name, "runs": {"0": {}}} for name in ("a", "b")}
SIZE = 40, 60


@pytest.fixture
def folder(tmp_path):
    """Two methods that differ much on the left, and a little on the right, where the first is off by .2."""
    truth = np.full((*SIZE, 3), 0.5)
    for name, (left, right) in {"a": (1.0, 0.7), "b": (0.5, 0.5)}.items():
        picture = truth.copy()
        picture[16:20, 4:8], picture[16:20, 48:52] = left, right
        run = tmp_path / "seed_0" / name
        write_png(run / "test" / "v.png", picture)
        write_png(run / "test" / "v_gt.png", truth)
        (run / "metrics.json").write_text(json.dumps({"views": {"v": {"psnr": 30.0}}}))
    return tmp_path


def cropped(folder, mask_of=None) -> Crops:
    found = crops(folder, ROWS, mask_of)
    assert found is not None
    return found


def window(found: Crops) -> float:
    """Where the middle of the window is, in shares of the width."""
    (mark,) = found.figures[0].marks
    return (mark["left"] + mark["width"] / 2) / 100


def test_the_window_is_where_methods_differ_most(folder):
    found = cropped(folder)
    assert window(found) < 0.5 and not found.masked


def test_what_masks_leave_out_does_not_count(folder):
    mask = np.zeros(SIZE, np.float32)
    mask[16:18, 48:52] = 1
    found = cropped(folder, {"v": mask}.get)
    assert window(found) > 0.5 and found.masked
    off = (round(0.7 * 255) - round(0.5 * 255)) / 255
    assert found.figures[2].caption == f"a, {-20 * np.log10(off):.2f} dB"
    assert not cropped(folder, {"other": mask}.get).masked


def test_a_view_in_which_nothing_that_counts_differs_is_shown_as_it_is(folder):
    found = cropped(folder, {"v": np.zeros(SIZE, np.float32)}.get)
    assert [figure.caption for figure in found.figures[2:]] == ["a, 100.00 dB", "b, 100.00 dB"]

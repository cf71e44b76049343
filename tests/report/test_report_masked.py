"""What a report says of the masks of a run."""

import json
from typing import Any

import numpy as np
from html_pages import parsed, section, words
from mi_dogsplat.report.write import write_report
from PIL import Image

HEADING = "What the masks hide"


def said(folder, masked: dict[str, Any] | None):
    folder.mkdir(exist_ok=True)
    metrics = {"n": 3} if masked is None else {"n": 3, "masked": masked}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    return section(parsed(write_report(folder).read_text()), HEADING)


def test_masked_photographs_are_counted_and_those_that_are_mostly_masked_are_named(tmp_path):
    shares = {"a": 0.0, "b": 0.1, "c": 0.9, "d": 0.6, "e": 0.5}
    Image.fromarray(np.zeros((30, 40, 3), np.uint8)).save(tmp_path / "masked.png")
    part = said(tmp_path, shares)
    assert part is not None
    assert "4 of 5 training photographs are masked in part: 42.0 % of their pixels" in words(part)
    assert "More than half of c, d is masked." in words(part)
    (picture,) = part.iter("img")
    assert picture.get("src", "").startswith("data:image/jpeg;base64,")


def test_without_the_sheet_or_anything_masked_there_is_no_picture(tmp_path):
    part = said(tmp_path / "no sheet", {"a": 0.25, "b": "much"})
    assert part is not None and "1 of 1 training photographs" in words(part) and not list(part.iter("img"))
    assert "red" not in words(part) and "More than half" not in words(part)
    part = said(tmp_path / "white", {"a": 0.0, "b": 0.0})
    assert part is not None and "The masks are white: all pixels of the 2 training photographs count." in words(part)
    assert said(tmp_path / "none", None) is None and said(tmp_path / "broken", {"a": "much"}) is None

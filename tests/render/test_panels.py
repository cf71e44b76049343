"""A panel keeps its picture, and its text fits below."""

import numpy as np
import pytest
from mi_dogsplat.render.panels import SIZE, labelled

GREY = np.full((20, 120, 3), 0.5)


@pytest.mark.parametrize("text", ["dogsplat", "a text that is much wider than the picture that it is below"])
def test_the_text_is_below_the_picture_and_within_its_width(text):
    panel = labelled(GREY, text)
    assert panel.shape == (20 + round(2.5 * SIZE), 120, 3)
    assert (panel[:20] == GREY).all()
    ink = panel[20:].min(axis=(0, 2)) < 0.9  # [W]
    assert 30 < ink.sum() and not ink[0] and not ink[-1]


def test_larger_letters_have_a_higher_line():
    assert labelled(GREY, "dogsplat", 2 * SIZE).shape == (20 + 5 * SIZE, 120, 3)


def test_a_panel_without_text_has_an_empty_line():
    assert (labelled(GREY, "")[20:] == 1).all()

"""Models as one only where they are drawn alike."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from foreign_model import model as foreign
from mi_dogsplat import Drawing, Model, read_model, write_model

SPLATS = foreign()
DIFFERENT = [
    (Drawing(antialiased=True), Drawing(antialiased=False), "antialiased True and False"),
    (Drawing(), Drawing(antialiased=True), "antialiased False and True"),
    (Drawing(linear=True), Drawing(), "linear True and False"),
    (Drawing(near_clip=0.01), Drawing(), "near_clip 0.01 and 0.2"),
    (Drawing(white=2.0, linear=True), Drawing(linear=True), "white 2 and 1"),
    (Drawing(scale=0.30999999493360519), Drawing(scale=0.3), "scale 0.31 and 0.3"),
    (Drawing(), Drawing(scale=0.31), "scale 1 and 0.31"),
    (Drawing(up="z"), Drawing(up="y"), "up z and y"),
    (Drawing(up="0,0.6,0.8"), Drawing(), "up 0,0.6,0.8 and -y"),
    (Drawing(antialiased=True, up="z"), Drawing(scale=2.0), "antialiased True and False, scale 1 and 2, up z and"),
]


@pytest.mark.parametrize(("a", "b", "what"), DIFFERENT, ids=[what for *_, what in DIFFERENT])
def test_what_is_drawn_otherwise_is_not_joined_and_the_line_says_why(a, b, what):
    with pytest.raises(ValueError) as error:
        Model(SPLATS, a).joined(Model(SPLATS, a), Model(SPLATS, b))
    text = str(error.value)
    assert f"model 0 and model 2 are not drawn alike: {what}" in text and "; make them alike" in text
    assert "\n" not in text
    assert Model(SPLATS.joined(SPLATS), a).splats.n_splats == 24  # the way out


@pytest.mark.parametrize(
    ("wrong", "remedy"), [(SPLATS, "Model(splats)"), ([Model(SPLATS)], "Model.joined(*models)")], ids=["splats", "list"]
)
def test_what_is_no_model_is_refused_and_the_line_says_how_to_make_one(wrong: Any, remedy):
    with pytest.raises(ValueError, match=f"model 2 is of the class {type(wrong).__name__}, not Model; ") as error:
        Model(SPLATS).joined(Model(SPLATS), wrong)
    assert remedy in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(ValueError, match="Splats.joined: model 1 is of the class Model, not Splats; .*model.splats"):
        SPLATS.joined(cast(Any, Model(SPLATS)))


def test_how_a_model_is_drawn_is_a_drawing():
    with pytest.raises(ValueError, match="how it is drawn is of the class dict, not Drawing; give a Drawing"):
        Model(SPLATS, cast(Any, {"up": "z"}))


def test_what_one_says_and_the_others_take_for_granted_is_said_of_the_whole():
    said = Drawing(antialiased=False, near_clip=0.2, linear=False, up="-y", scale=1.0, white=1.0)
    whole = Model(SPLATS).joined(Model(SPLATS, said), Model(SPLATS, Drawing(up="0,-2,0", near_clip=0.2000001)))
    assert whole.drawing == replace(said, up="-y") and whole.splats.n_splats == 36
    assert Model(SPLATS).joined(Model(SPLATS)).drawing == Drawing()


def test_what_was_left_out_of_any_is_said_once():
    a, b = Model(SPLATS, left_out=("its sound", "its smell")), Model(SPLATS, left_out=("its smell", "its weight"))
    assert a.joined(b).left_out == ("its sound", "its smell", "its weight")


def test_files_become_one_file(tmp_path):
    drawing = Drawing(antialiased=True, up="z")
    write_model(tmp_path / "a.ply", Model(SPLATS, drawing))
    read = read_model(tmp_path / "a.ply")
    write_model(tmp_path / "both.ply", read.joined(read))
    both = read_model(tmp_path / "both.ply")
    assert both.drawing == drawing
    np.testing.assert_array_equal(both.splats.means, np.tile(SPLATS.means, (2, 1)))

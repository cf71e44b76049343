"""Slopes, curvatures, cuts and shifts in files: a PLY keeps them, a compressed one in bytes; others leave them out."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from cut_models import kept_shares, with_cuts, with_second_cuts
from mi_dogsplat import Drawing, Model, read_model, write_model
from mi_dogsplat.formats.packing import morton_order
from mi_dogsplat.formats.sizes import KINDS, FileKind, by_part, prices
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.formats.upright import upright
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.scene.whole import whole
from places import points_in
from row_kinds import RowKind, of_each
from shifted_models import moves_seen, with_shifts
from sloped_models import curvature_brightness, slope_colors, with_curvatures, with_slopes
from splat_scenes import random_splats, rounded


@dataclass(frozen=True)
class Kind(RowKind):
    """Rows of some primitives."""

    given: Callable[[Splats], Splats]  # every third primitive has some
    left_out: Callable[[Splats], Splats]  # as by formats that have no room for them
    said: str  # by these, of 100 primitives
    row_bytes: int  # in a PLY
    shown: Callable[[Splats, np.ndarray], np.ndarray]  # at points in the world
    close: float  # how near that stays in another frame
    room: str  # field of formats that have room for them

    def model(self, n: int, dog_share: float = 0.3) -> Splats:
        return self.given(rounded(random_splats(n, seed=4, degree=1, dog_share=dog_share)))


def with_slopes_and_cuts(splats: Splats) -> Splats:
    return with_cuts(with_slopes(splats, every=5), every=3)


def with_all(splats: Splats) -> Splats:
    return with_second_cuts(with_curvatures(with_slopes_and_cuts(splats), every=4), every=3)


SLOPED = Kind(
    "slopes", SLOPES, partial(with_slopes, every=3), Splats.without_slopes,
    "cannot hold colours that vary over a primitive: the slopes of 100 are left out; each has its mean colour", 40,
    slope_colors, 2e-4, "slopes",
)  # fmt: skip
CURVED = Kind(
    "curvatures", CURVATURES, partial(with_curvatures, every=3), Splats.without_curvatures,
    SLOPED.said.replace("slopes", "curvatures"), 28, curvature_brightness, 2e-4, "slopes",
)  # fmt: skip
CUT = Kind(
    "cuts", CUTS, with_slopes_and_cuts, whole,
    "cannot hold cuts: those of 100 are left out; each becomes the nearest whole primitive", 16,
    kept_shares, 1e-3, "cuts",
)  # fmt: skip
SECOND_CUT = Kind(
    "second_cuts", SECOND_CUTS, with_all, whole, CUT.said, 16, partial(kept_shares, plane=SECOND_CUTS), 1e-3, "cuts"
)
SHIFTED = Kind(
    "shifts", SHIFTS, lambda splats: with_shifts(with_all(splats), every=3), Splats.without_shifts,
    "cannot hold places that depend on the view: the shifts of 100 are left out; each has its mean place", 52,
    moves_seen, 1e-4, "shifts",
)  # fmt: skip
each_kind = of_each(SLOPED, CURVED, CUT, SECOND_CUT, SHIFTED)
NO_ROOM = [".glb", ".gltf", ".sog", ".splat", ".spz", ".usd", ".usda", ".usdc", ".usdz"]


@each_kind
def test_ply_and_compressed_ply_alone_hold_them(kind):
    assert sorted(suffix for suffix, chosen in FORMATS.items() if not getattr(chosen, kind.room)) == NO_ROOM


@each_kind
@pytest.mark.parametrize("sh_rows", [False, True])
def test_a_ply_says_nothing_as_it_keeps_them(kind, sh_rows, tmp_path):
    truth = kind.model(2000)
    assert write_model(tmp_path / "a.ply", truth, sh_rows=sh_rows) == []
    np.testing.assert_array_equal(kind.values(read_model(tmp_path / "a.ply").splats), kind.values(truth))


@each_kind
def test_they_go_through_a_compressed_ply_by_name_in_its_order(kind, tmp_path):
    truth = kind.model(2000)
    assert write_model(tmp_path / "a.compressed.ply", truth) == []
    back, expected = read_model(tmp_path / "a.compressed.ply").splats, truth.select(morton_order(truth.means))
    np.testing.assert_array_equal(kind.index(back), kind.index(expected))
    np.testing.assert_allclose(kind.values(back), kind.values(expected), atol=0.03, rtol=0.03)


@of_each(SLOPED, CURVED)
def test_what_is_a_colour_goes_through_a_compressed_ply_in_units_of_white(kind, tmp_path):
    truth = kind.model(2000)
    write_model(tmp_path / "a.compressed.ply", truth)
    values = kind.values(read_model(tmp_path / "a.compressed.ply").splats)
    linear = Model(brightened(truth, 40.0), Drawing(linear=True, white=40.0))
    assert write_model(tmp_path / "b.compressed.ply", linear) == []
    found = kind.values(read_model(tmp_path / "b.compressed.ply").splats)
    np.testing.assert_allclose(found, 40 * values, rtol=1e-3, atol=1e-4)


@each_kind
@pytest.mark.parametrize("suffix", NO_ROOM)
def test_other_formats_have_what_is_nearest_and_a_line_that_says_so(kind, suffix, tmp_path):
    truth = kind.model(300, dog_share=0)
    lost, said = write_model(tmp_path / f"with{suffix}", truth), f"{FORMATS[suffix].name} {kind.said}"
    assert lost.count(said) == 1
    assert write_model(tmp_path / f"without{suffix}", kind.left_out(truth)) == [x for x in lost if x != said]
    assert (tmp_path / f"with{suffix}").read_bytes() == (tmp_path / f"without{suffix}").read_bytes()
    assert kind.n(read_model(tmp_path / f"with{suffix}").splats) == 0 and kind.n(truth) == 100


@each_kind
def test_an_upright_model_shows_the_same_where_its_points_are(kind):
    truth = kind.given(random_splats(30))
    turned, matrix = upright(Model(truth, Drawing(up="x", scale=0.3)))
    points = points_in(truth, kind.index(truth))
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(kind.shown(turned.splats, moved), kind.shown(truth, points), atol=kind.close)


@each_kind
@pytest.mark.parametrize("dog_share", [0, 0.3])
def test_the_price_of_a_row_is_that_of_the_file(kind, dog_share):
    splats = kind.model(500, dog_share).with_sh_degrees(np.arange(500) % 2)
    ply = FileKind("ply")
    known, others = prices(ply, splats), kind.without(splats)
    header = [ply.encoded(s).index(b"end_header\n") for s in (splats, others)]
    assert known.rows[kind.group] == kind.row_bytes and known.scaled(3).rows[kind.group] == 3 * kind.row_bytes
    assert known.of(splats) - known.of(others) == ply.size(splats) - ply.size(others) - (header[0] - header[1])


@each_kind
@pytest.mark.parametrize("name", KINDS)
def test_parts_add_up_to_the_file(kind, name):
    splats = kind.model(400)
    parts, others = by_part(FileKind(name), splats), by_part(FileKind(name), kind.without(splats))
    assert sum(parts.values()) == FileKind(name).size(splats)
    assert list(parts)[-1] == kind.word if name == "ply" else kind.word not in parts
    assert {part: size for part, size in parts.items() if part != kind.word} == others


@each_kind
@pytest.mark.parametrize("name", ["spz", "sog"])
def test_what_a_training_will_end_as_has_none_where_the_format_has_none(kind, name):
    splats = kind.model(400)
    assert kind.n(FileKind(name).foreseen(splats)) == 0 and prices(FileKind(name), splats).rows[kind.group] == 0
    assert FileKind("ply").foreseen(splats) is splats

"""Slopes, curvatures, cuts and shifts as bytes of a compressed PLY: how near, how many, how damage is told."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from cut_models import kept_shares, with_cuts, with_second_cuts
from mi_dogsplat import read_model
from mi_dogsplat.formats import compressed_ply
from mi_dogsplat.formats.trailer import CURVATURES as CURVATURE_ROWS
from mi_dogsplat.formats.trailer import CUTS as CUT_ROWS
from mi_dogsplat.formats.trailer import SECOND_CUTS as SECOND_CUT_ROWS
from mi_dogsplat.formats.trailer import SHIFTS as SHIFT_ROWS
from mi_dogsplat.formats.trailer import SLOPES as SLOPE_ROWS
from mi_dogsplat.formats.trailer import Rows, encode
from mi_dogsplat.scene.row_groups import CURVATURES, CUTS, SECOND_CUTS, SHIFTS, SLOPES, RowGroup
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.support.errors import DataError
from places import points_in
from row_kinds import RowKind, of_each
from shifted_models import moves_seen
from sloped_models import with_curvatures, with_slopes
from splat_scenes import random_splats, rounded

N = 2000
GAPS = [0, 1, 254, 255, 256, 257, 511, 512, 768, 1999]  # primitives with rows: steps around those of a byte


def some_strong(n: int, *shape: int) -> np.ndarray:
    return np.clip(np.random.default_rng(1).standard_cauchy((n, *shape)) * 0.1, -5, 5)


def slopes_changed(back: Splats, truth: Splats) -> float:
    return float(np.abs(back.color_slopes - truth.color_slopes).mean())


def curvatures_changed(back: Splats, truth: Splats) -> float:
    return float(np.abs(back.brightness_curvatures - truth.brightness_curvatures).mean())


def normals(n: int) -> np.ndarray:
    return np.random.default_rng(7).normal(0, 6, (n, 3))


def kept_share_changed(back: Splats, truth: Splats, plane: RowGroup = CUTS) -> float:
    """In the places of the truth, which a compressed PLY moves too."""
    points, (name,) = points_in(truth, getattr(truth, plane.index)), plane.names
    same_planes = replace(truth, **{name: getattr(back, name)})
    return float(np.abs(kept_shares(same_planes, points, plane) - kept_shares(truth, points, plane)).mean())


def moves_changed(back: Splats, truth: Splats) -> float:
    """In standard deviations, as the truth is seen from around."""
    points = truth.means[truth.shift_index][:, None] + np.random.default_rng(2).normal(0, 9, (truth.n_shifts, 5, 3))
    same_places = replace(truth, view_shifts=back.view_shifts, mean_views=back.mean_views)
    return float(np.abs(moves_seen(same_places, points) - moves_seen(truth, points)).mean())


@dataclass(frozen=True)
class Kind(RowKind):
    """Rows as numbers with a unit, below which they are told apart evenly; behind what may come before, or alone."""

    rows: Rows
    unit: float
    random: Callable[[int], np.ndarray]
    changed: Callable[[Splats, Splats], float]
    before: Callable[[Splats], Splats] = rounded

    def model(self, index=tuple(range(0, N, 3)), dog_share: float = 0) -> Splats:
        before = self.before(rounded(random_splats(N, seed=4, degree=1, dog_share=dog_share)))
        return replace(before, **self._rows(index))

    def without(self, splats: Splats) -> Splats:
        """All else as it is: curvatures that go leave no mean brightness."""
        return replace(splats, **self._rows(()))

    def _rows(self, index: Sequence[int]) -> dict[str, np.ndarray]:
        found = {self.group.index: np.array(index, np.uint32), self.name: self.random(len(index))}
        for name in self.group.names[1:]:  # directions
            found[name] = np.random.default_rng(9).uniform(-0.7, 0.7, (len(index), *self.group.arrays[name]))
        return found


SLOPED = Kind("slopes", SLOPES, SLOPE_ROWS, 1 / 64, lambda n: some_strong(n, 3, 3), slopes_changed)
CURVED = Kind("curvatures", CURVATURES, CURVATURE_ROWS, 1 / 64, lambda n: some_strong(n, 6), curvatures_changed)
BEHIND_SLOPES = replace(CURVED, before=partial(with_slopes, every=5))
CUT = Kind("cuts", CUTS, CUT_ROWS, 1, normals, kept_share_changed)
BEHIND = replace(CUT, before=partial(with_slopes, every=5))
SECOND_CUT = Kind(
    "second_cuts", SECOND_CUTS, SECOND_CUT_ROWS, 1, normals, partial(kept_share_changed, plane=SECOND_CUTS)
)
BEHIND_ALL = replace(
    SECOND_CUT, before=lambda splats: with_cuts(with_curvatures(with_slopes(splats, every=5), every=6), every=4)
)
SHIFTED = Kind("shifts", SHIFTS, SHIFT_ROWS, 1 / 64, lambda n: some_strong(n, 3, 3), moves_changed)
LAST = replace(
    SHIFTED, before=lambda splats: with_second_cuts(with_cuts(with_curvatures(with_slopes(splats, every=5), every=6)))
)


@pytest.mark.parametrize("index", [GAPS, [0], [1999], [1020], range(N), range(0, N, 3), range(0, N, 700), []])
@pytest.mark.parametrize("dog_share", [0, 0.3])
@of_each(SLOPED, CURVED, BEHIND_SLOPES, CUT, BEHIND, SECOND_CUT, BEHIND_ALL, SHIFTED, LAST)
def test_they_are_within_half_a_step_and_nothing_else_changes(kind, index, dog_share, tmp_path):
    truth, path = kind.model(index, dog_share), tmp_path / "model.compressed.ply"
    path.write_bytes(compressed_ply.encode(truth))
    back, other = compressed_ply.read(path).splats, tmp_path / "without.compressed.ply"
    assert np.array_equal(kind.index(back), kind.index(truth))
    if len(index):
        values = [kind.values(splats).astype(float) for splats in (back, truth)]
        logs = [np.sign(v) * np.log(1 + np.abs(v) / kind.unit) for v in values]
        steps = np.ptp(logs[1], axis=0) / 255
        assert (np.abs(logs[0] - logs[1]).max(axis=0) <= 0.501 * steps + 1e-6).all()
        assert kind.changed(back, truth) < 0.01
    other.write_bytes(compressed_ply.encode(kind.without(truth)))
    for name, array in vars(compressed_ply.read(other).splats).items():
        if name not in (kind.group.index, *kind.group.names):
            np.testing.assert_array_equal(getattr(back, name), array)


@of_each(SLOPED, CURVED, CUT, SECOND_CUT, SHIFTED)
def test_rows_by_hand(kind):
    """-log 2 and log 4 of units, each the end of its column; behind them the directions of shifts, as they are."""
    values, n = np.zeros((2, *kind.group.arrays[kind.name])), kind.group.row_size
    values[0].ravel()[1], values[1].ravel()[-1] = -kind.unit, 3 * kind.unit
    beside = {name: np.array([[0, -0.25, 0], [0, 0.5, 1]]) for name in kind.group.names[1:]}
    rows = {kind.group.index: np.array([2, 258]), kind.name: values} | beside
    comments, trailer = encode(replace(rounded(random_splats(600, dog_share=0)), **rows))
    assert comments == [f"dogsplat {kind.word} 1 3"]
    low, high = np.array(struct.unpack_from(f"<{2 * n}f", trailer)).reshape(2, n)
    of_low, of_high, of_row = ([0, -0.25, 0], [0, 0.5, 1], [0, 255, 255]) if beside else ([], [], [])
    zeros = [0] * (n - len(of_low) - 2)
    assert low == pytest.approx([0, -np.log(2), *zeros, *of_low], abs=1e-6)
    assert high == pytest.approx([0, *zeros, np.log(4), *of_high], abs=1e-6)
    coded = np.frombuffer(trailer, np.uint8, offset=8 * n).reshape(3, 1 + n).tolist()
    assert coded[0] == [2, *[0] * n] and coded[1][0] == 255 and coded[2] == [0, 0, 255, *zeros[1:], 255, *of_row]


def test_mean_views_are_within_half_a_step_of_their_bounds(tmp_path):
    truth, path = SHIFTED.model(), tmp_path / "model.compressed.ply"
    truth.mean_views[:5] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]]
    path.write_bytes(compressed_ply.encode(truth))
    apart = np.abs(compressed_ply.read(path).splats.mean_views - truth.mean_views).max(axis=0)
    assert (apart < np.ptp(truth.mean_views, axis=0) / 510 + 1e-6).all() and 0.003 < apart.max() < 0.004


@pytest.mark.parametrize(
    ("kind", "bounds_bytes", "row_bytes"),
    [(SLOPED, 72, 10), (BEHIND_SLOPES, 48, 7), (BEHIND, 24, 4), (BEHIND_ALL, 24, 4), (LAST, 96, 13)],
    ids=["slopes", "curvatures", "cuts", "second_cuts", "shifts"],
)  # fmt: skip
def test_what_a_row_takes(kind, bounds_bytes, row_bytes):
    full = kind.model(range(0, N, 2), dog_share=0.5)
    added = len(compressed_ply.encode(full)) - len(compressed_ply.encode(kind.without(full)))
    assert kind.rows.size(1000) == bounds_bytes + row_bytes * 1000
    assert added == kind.rows.size(1000) + len(f"comment dogsplat {kind.word} 1 1000\n")


def test_the_kinds_stand_in_their_order_and_a_model_of_none_has_no_byte_of_them():
    full = LAST.model(dog_share=0.5)
    kinds = ["dog", "slopes", "curvatures", "cuts", "second_cuts", "shifts"]
    assert [line.split()[1] for line in encode(full)[0]] == kinds
    assert b"dogsplat" not in compressed_ply.encode(full.plain().without_slopes().without_cuts().without_shifts())


@pytest.mark.parametrize("normal", [0.0, 1e38, -3e38])
@of_each(CUT, SECOND_CUT)
def test_normals_of_any_size_can_be_read_again(kind, normal, tmp_path):
    path, cut = tmp_path / "a.compressed.ply", kind.model()
    kind.values(cut)[:], kind.values(cut)[1, 2] = normal, 1
    path.write_bytes(compressed_ply.encode(cut))
    found = kind.values(compressed_ply.read(path).splats)[0, 0]
    assert np.isfinite(found) and (found == 0 if normal == 0 else 1e36 < found / np.sign(normal) < 1e38)


@pytest.mark.parametrize(
    ("kind", "damage", "complaint"),
    [
        (SLOPED, lambda b: b.replace(b"slopes 1 ", b"slopes 2 "), "its slope rows are of version 2, known is 1"),
        (SLOPED, lambda b: b.replace(b"slopes 1 ", b"slides 1 "), "0 slope rows are 0"),
        (SLOPED, lambda b: b.replace(b"dog 1 ", b"fog 1 "), "0 DoG rows are 0"),
        (SLOPED, lambda b: b[:-1], "bytes follow the last element"),
        (SLOPED, lambda b: b + b"x", "bytes follow the last element"),
        (SLOPED, lambda b: b[:-10] + b"\xfe" + b[-9:], "a slope row is for primitive"),
        (BEHIND_SLOPES, lambda b: b.replace(b"curvatures 1 ", b"curvatures 2 "), "its curvature rows are of version 2"),
        (BEHIND_SLOPES, lambda b: b.replace(b"curvatures 1 ", b"curvature 1 "), "0 curvature rows are 0"),
        (BEHIND_SLOPES, lambda b: b.replace(b"slopes 1 ", b"slides 1 "), "0 slope rows are 0"),
        (BEHIND_SLOPES, lambda b: b[:-1], "bytes follow the last element"),
        (BEHIND_SLOPES, lambda b: b[:-7] + b"\xfe" + b[-6:], "a curvature row is for primitive"),
        (BEHIND, lambda b: b.replace(b"cuts 1 ", b"cuts 2 "), "its cut rows are of version 2, known is 1"),
        (BEHIND, lambda b: b.replace(b"cuts 1 ", b"cats 1 "), "0 cut rows are 0"),
        (BEHIND, lambda b: b.replace(b"slopes 1 ", b"slides 1 "), "0 slope rows are 0"),
        (BEHIND, lambda b: b[:-1], "bytes follow the last element"),
        (BEHIND, lambda b: b[:-4] + b"\xfe" + b[-3:], "a cut row is for primitive"),
        (BEHIND_ALL, lambda b: b.replace(b"second_cuts 1 ", b"second_cuts 2 "), "its second cut rows are of version 2"),
        (BEHIND_ALL, lambda b: b.replace(b"second_cuts 1 ", b"second_cats 1 "), "0 second cut rows are 0"),
        (BEHIND_ALL, lambda b: b.replace(b"dogsplat cuts 1 ", b"dogsplat cats 1 "), "0 cut rows are 0"),
        (BEHIND_ALL, lambda b: b.replace(b"curvatures 1 ", b"curvature 1 "), "0 curvature rows are 0"),
        (BEHIND_ALL, lambda b: b[:-1], "bytes follow the last element"),
        (BEHIND_ALL, lambda b: b[:-4] + b"\xfe" + b[-3:], "a second cut row is for primitive"),
        (LAST, lambda b: b.replace(b"shifts 1 ", b"shifts 2 "), "its shift rows are of version 2, known is 1"),
        (LAST, lambda b: b.replace(b"shifts 1 ", b"shafts 1 "), "0 shift rows are 0"),
        (LAST, lambda b: b.replace(b"second_cuts 1 ", b"second_cats 1 "), "0 second cut rows are 0"),
        (LAST, lambda b: b[:-1], "bytes follow the last element"),
        (LAST, lambda b: b[:-13] + b"\xfe" + b[-12:], "a shift row is for primitive"),
    ],
)
def test_damage_is_told_in_one_line(kind, damage, complaint, tmp_path):
    path = tmp_path / "a.compressed.ply"
    before = compressed_ply.encode(kind.model(dog_share=0.3))
    after = damage(before)
    assert after != before
    path.write_bytes(after)
    with pytest.raises(DataError) as error:
        read_model(path)
    assert complaint in str(error.value) and len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("kind", "bounds"),
    [
        (SLOPED, (np.nan,) * 18),
        (SLOPED, (1, *(0,) * 17)),
        (SLOPED, (0,) * 17 + (np.inf,)),
        (SLOPED, (0,) * 9 + (1e5,) * 9),
        (CURVED, (np.nan,) * 12),
        (CURVED, (1, *(0,) * 11)),
        (CURVED, (0,) * 11 + (np.inf,)),
        (CURVED, (0,) * 6 + (1e5,) * 6),
        (CUT, (np.nan,) * 6),
        (CUT, (1, *(0,) * 5)),
        (CUT, (0,) * 3 + (90.0,) * 3),
        (SECOND_CUT, (np.nan,) * 6),
        (SECOND_CUT, (0,) * 3 + (90.0,) * 3),
        (SHIFTED, (np.nan,) * 24),
        (SHIFTED, (0,) * 23 + (np.inf,)),
        (SHIFTED, (0,) * 12 + (90.0,) * 12),
    ],
)
def test_bounds_that_make_no_sense_are_refused(kind, bounds, tmp_path):
    path, (_, trailer) = tmp_path / "a.compressed.ply", encode(kind.model())
    content, bounds_bytes = compressed_ply.encode(kind.model()), struct.pack(f"<{len(bounds)}f", *bounds)
    path.write_bytes(content[: -len(trailer)] + bounds_bytes + trailer[len(bounds_bytes) :])
    with pytest.raises(DataError, match=f"bounds of its {kind.rows.kind} rows"):
        read_model(path)

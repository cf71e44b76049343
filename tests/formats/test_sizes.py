"""Bytes by what a primitive holds, against files."""

import dataclasses

import numpy as np
import pytest
from mi_dogsplat import write_ply
from mi_dogsplat.formats import sizes
from mi_dogsplat.formats.sizes import KINDS, FileKind, Prices, by_part, prices
from mi_dogsplat.scene.drawing import Drawing
from mi_dogsplat.scene.radiance import brightened
from mi_dogsplat.scene.row_groups import DOG, SHIFTS
from mi_dogsplat.scene.splats import Splats
from shifted_models import with_shifts
from sloped_models import with_curvatures, with_slopes
from splat_scenes import random_splats, rounded

N = 3000


def model(n: int = N, shares=(0.4, 0.3, 0.2, 0.1), dog_share=0.3) -> Splats:
    splats = rounded(random_splats(n, seed=3, degree=3, dog_share=dog_share))
    return splats.with_sh_degrees(np.random.default_rng(0).choice(4, n, p=shares))


@pytest.mark.parametrize("shares", [(0.4, 0.3, 0.2, 0.1), (0, 0.5, 0, 0.5), (0.5, 0.5, 0, 0)])
@pytest.mark.parametrize("dog_share", [0, 0.3])
def test_prices_of_ply_are_those_of_the_file(tmp_path, shares, dog_share):
    splats = model(500, shares, dog_share)
    write_ply(tmp_path / "model.ply", splats, "rows")
    size = (tmp_path / "model.ply").stat().st_size
    header = (tmp_path / "model.ply").read_bytes().index(b"end_header\n") + len(b"end_header\n")
    known = prices(FileKind("ply"), splats)
    assert known.of(splats) - known.fixed == size - header
    assert FileKind("ply").size(splats) == size


@pytest.mark.parametrize("name", KINDS)
def test_a_file_of_a_model_in_units_of_white_is_that_of_its_radiance(name):
    splats, drawing = model(500), Drawing(linear=True, white=3.7)
    expected = FileKind(name, drawing).encoded(brightened(splats, 3.7))
    assert FileKind(name, drawing, in_units_of_white=True).encoded(splats) == expected


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_prices_of_compressed_files_come_near_to_them_and_bands_cost(name):
    splats = model(dog_share=0)
    known = prices(FileKind(name), splats)
    assert all(more > less > 0 for less, more in zip(known.bands, known.bands[1:], strict=False))
    kind = FileKind(name)
    assert known.of(splats) == pytest.approx(kind.size(kind.foreseen(splats)), rel=0.2)
    assert not any(known.rows.values())


def test_prices_follow_what_compresses():
    """Bands that are nearly alike take fewer bytes than others."""
    splats = model(dog_share=0).uniform_sh()
    alike = dataclasses.replace(splats, sh_coeffs=splats.sh_coeffs * np.array([1, *[0.02] * 15])[:, None])
    strong, faint = (prices(FileKind("spz"), s) for s in (splats, alike))
    assert faint.bands[3] - faint.bands[0] < 0.5 * (strong.bands[3] - strong.bands[0])
    assert faint.bands[0] == pytest.approx(strong.bands[0], rel=0.05)


def test_of_a_large_model_a_sample_is_encoded(monkeypatch):
    splats = model(dog_share=0)
    whole = prices(FileKind("spz"), splats)
    monkeypatch.setattr(sizes, "BLOCK", 100)
    monkeypatch.setattr(sizes, "BLOCKS", 8)
    largest = []
    encoded = FileKind.encoded
    monkeypatch.setattr(FileKind, "encoded", lambda kind, s: largest.append(s.n_splats) or encoded(kind, s))
    sampled = prices(FileKind("spz"), splats)
    assert max(largest) == 800
    np.testing.assert_allclose(sampled.bands, whole.bands, rtol=0.25)  # as small a sample compresses worse


def test_bands_that_nobody_has_cost_no_less_than_those_below():
    flat = prices(FileKind("spz"), model(shares=(0.5, 0.5, 0, 0), dog_share=0))
    assert flat.bands[1] < flat.bands[2] < flat.bands[3]


@pytest.mark.parametrize("name", KINDS)
def test_parts_add_up_to_the_file(name):
    splats = model(400)
    parts = by_part(FileKind(name), splats)
    assert sum(parts.values()) == FileKind(name).size(splats)
    assert list(parts) == ["primitives", "sh1", "sh2", "sh3"] + ["dog"] * (name == "ply")
    varied = with_shifts(with_curvatures(with_slopes(splats), every=3))
    more = by_part(FileKind(name), varied)
    assert sum(more.values()) == FileKind(name).size(varied)
    assert list(more) == [*parts] + ["slopes", "curvatures", "shifts"] * (name == "ply")
    flat = splats.plain().uniform_sh(0)
    assert by_part(FileKind(name), flat) == {"primitives": FileKind(name).size(flat)}


def test_prices_scale_but_for_what_the_file_needs_itself():
    known = Prices(10.0, (1.0, 2.0, 3.0, 4.0), {DOG: 5.0, SHIFTS: 11.0})
    assert known.scaled(2) == Prices(10.0, (2.0, 4.0, 6.0, 8.0), {DOG: 10.0, SHIFTS: 22.0})


def test_an_empty_model_has_no_prices():
    with pytest.raises(ValueError, match="empty"):
        prices(FileKind("spz"), Splats.empty(3))

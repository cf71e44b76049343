"""Bytes by what a primitive holds, against files."""

import numpy as np
import pytest
from mi_dogsplat import write_ply
from mi_dogsplat.formats import sizes
from mi_dogsplat.formats.sizes import Prices, by_part, encoded, prices
from mi_dogsplat.scene.splats import Splats
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
    known = prices("ply", splats)
    assert known.of(splats) - known.fixed == size - header
    assert len(encoded("ply", splats)) == size


@pytest.mark.parametrize("name", ["spz", "sog"])
def test_prices_of_compressed_files_come_near_to_them_and_bands_cost(name):
    splats = model(dog_share=0)
    known = prices(name, splats)
    assert all(more > less > 0 for less, more in zip(known.bands, known.bands[1:], strict=False))
    assert known.of(splats) == pytest.approx(len(encoded(name, splats)), rel=0.2)
    assert known.dog == 0


def test_prices_follow_what_compresses():
    """Coefficients of a few different values take fewer bytes than any."""
    splats = model(dog_share=0)
    coarse = splats.uniform_sh()
    coarse.sh_coeffs[:, 1:] = np.round(coarse.sh_coeffs[:, 1:] * 4) / 4
    fine, rounded_off = prices("spz", splats.uniform_sh()), prices("spz", coarse)
    assert rounded_off.bands[3] - rounded_off.bands[0] < 0.6 * (fine.bands[3] - fine.bands[0])


def test_of_a_large_model_a_sample_is_encoded(monkeypatch):
    splats = model(dog_share=0)
    whole = prices("spz", splats)
    monkeypatch.setattr(sizes, "BLOCK", 100)
    monkeypatch.setattr(sizes, "BLOCKS", 8)
    largest = []
    encode = sizes.ENCODERS["spz"]
    monkeypatch.setitem(sizes.ENCODERS, "spz", lambda splats: largest.append(splats.n_splats) or encode(splats))
    sampled = prices("spz", splats)
    assert max(largest) == 800
    np.testing.assert_allclose(sampled.bands, whole.bands, rtol=0.1)


def test_bands_that_nobody_has_cost_no_less_than_those_below():
    flat = prices("spz", model(shares=(0.5, 0.5, 0, 0), dog_share=0))
    assert flat.bands[1] < flat.bands[2] < flat.bands[3]


@pytest.mark.parametrize("name", sizes.ENCODERS)
def test_parts_add_up_to_the_file(name):
    splats = model(400)
    parts = by_part(name, splats)
    assert sum(parts.values()) == len(encoded(name, splats))
    assert list(parts) == ["primitives", "sh1", "sh2", "sh3"] + ["dog"] * (name == "ply")
    flat = splats.plain().uniform_sh(0)
    assert by_part(name, flat) == {"primitives": len(encoded(name, flat))}


def test_prices_scale_but_for_what_the_file_needs_itself():
    assert Prices(10.0, (1.0, 2.0, 3.0, 4.0), 5.0).scaled(2) == Prices(10.0, (2.0, 4.0, 6.0, 8.0), 10.0)


def test_an_empty_model_has_no_prices():
    with pytest.raises(ValueError, match="empty"):
        prices("spz", Splats.empty(3))

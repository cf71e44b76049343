"""Reading and writing a model of any format: the axes, what travels with it, and what is said to be lost."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import foreign_model
import numpy as np
import pytest
from mi_dogsplat import Drawing, Model, Splats, read_model, write_model
from mi_dogsplat.formats.table import FORMATS
from mi_dogsplat.scene.quaternions import unit_quaternions
from mi_dogsplat.support.errors import DataError
from ply_files import random_splats
from scipy.spatial.transform import Rotation
from written_models import written

EVERYTHING = Drawing(antialiased=True, near_clip=0.0625, linear=True, up="-x", scale=2.5)
LOSSLESS = (".ply", ".glb", ".gltf")


def nearest(back: Splats, model: Splats) -> Splats:
    """The primitives of ``model`` in the order of ``back``."""
    distance = np.abs(back.means[:, None] - model.means[None]).max(axis=-1)  # [N, N]
    assert distance.min(axis=1).max() < 0.01 and len(set(distance.argmin(axis=1))) == model.n_splats
    return model.select(distance.argmin(axis=1))


def covariances(model: Splats) -> np.ndarray:
    """[N, 3, 3]: several quaternions are one ellipsoid."""
    axes = Rotation.from_quat(unit_quaternions(model.quats)).as_matrix() * np.exp(model.log_scales)[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_gives_the_model_back_in_its_own_axes(tmp_path, suffix, degree):
    full = foreign_model.model()
    model = replace(full, sh_coeffs=np.pad(full.sh_coeffs, ((0, 0), (0, 7), (0, 0)))[:, : (degree + 1) ** 2])
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert back.sh_degree == (0 if suffix == ".splat" else degree)
    model = nearest(back, model)
    exact = 1e-5 if suffix in LOSSLESS else 0.05
    largest = np.exp(2 * model.log_scales.max(axis=1))[:, None, None]
    assert covariances(back) / largest == pytest.approx(covariances(model) / largest, abs=1.5 * exact, rel=exact)
    assert back.opacities == pytest.approx(model.opacities, abs=0.003)
    kept = slice(1) if suffix in (".splat", ".sog") else slice(None)  # a palette has fewer entries than primitives
    assert back.sh_coeffs[:, kept] == pytest.approx(model.sh_coeffs[:, kept], abs=exact)


def test_ply_and_gltf_keep_every_bit_of_what_they_hold_raw(tmp_path):
    model = foreign_model.model()
    for suffix in LOSSLESS:
        back = read_model(written(tmp_path / f"a{suffix}", model)).splats
        assert np.array_equal(back.means, model.means) and np.array_equal(back.sh_coeffs, model.sh_coeffs)


@pytest.mark.parametrize("suffix", FORMATS)
def test_what_a_format_can_say_of_the_drawing_travels_and_the_rest_is_named_in_one_line(tmp_path, suffix):
    lost = write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), EVERYTHING))
    carries = FORMATS[suffix].carries
    kept = {name: value for name, value in EVERYTHING.said().items() if name in carries}
    assert read_model(tmp_path / f"a{suffix}").drawing == Drawing(**kept)
    missing = [name for name in EVERYTHING.said() if name not in carries]
    assert all(any(f"{name} " in line for line in lost) for name in missing) and all("\n" not in line for line in lost)
    assert bool(lost) == bool(missing or suffix == ".splat")
    assert len(carries) >= 1 or suffix == ".splat"


def test_a_format_that_cannot_say_what_is_usual_loses_nothing(tmp_path):
    usual = Drawing(antialiased=False, near_clip=0.2, linear=False, scale=1.0)
    assert write_model(tmp_path / "a.spz", Model(foreign_model.model(), usual)) == []


@pytest.mark.parametrize(("suffix", "low", "high", "said"), [
    (".spz", -10, 5.9375, "SPZ has no scales below 4.54e-05 or above 379, to which it clamps 2 primitives"),
    (".compressed.ply", -20, 20, "compressed PLY has no scales below 2.06e-09 or above 4.85e+08, to which it clamps 2"),
    (".sog", -10, 20, ""),
])  # fmt: skip
def test_scales_that_a_format_cannot_say_are_told(tmp_path, suffix, low, high, said):
    model = foreign_model.model()
    log_scales = model.log_scales.copy()
    log_scales[0], log_scales[1], log_scales[2] = low - 2, (0, high + 1, 0), (0, 0, low - 2)  # the last is just flat
    lost = write_model(tmp_path / f"a{suffix}", replace(model, log_scales=log_scales))
    assert len(lost) == bool(said) and all(line.startswith(said) for line in lost)


@pytest.mark.parametrize("suffix", [".ply", ".sog", ".glb"])
def test_a_drawing_may_be_told_in_numbers_of_numpy(tmp_path, suffix):
    told: dict[str, Any] = {"antialiased": np.True_, "near_clip": np.float32(0.25), "scale": np.float64(0.5)}
    write_model(tmp_path / f"a{suffix}", Model(foreign_model.model(), Drawing(**told)))
    read = read_model(tmp_path / f"a{suffix}").drawing
    assert (read.antialiased, read.near_clip, read.scale) == (True, 0.25, 0.5)


@pytest.mark.parametrize(
    "told",
    [
        {"near_clip": -1.0},
        {"white": 0.0},
        {"up": "upwards"},
        {"up": (0, 0, 1)},
        {"scale": float("nan")},
        {"antialiased": "maybe"},
        {"linear": np.float32(0.5)},
    ],
)
def test_a_drawing_that_no_reader_would_take_is_none(told: dict[str, Any]):
    (name,) = told
    with pytest.raises(ValueError, match=f"^Drawing: {name} is .*, it must be ") as error:
        Drawing(**told)
    assert "\n" not in str(error.value)


def with_one_far_away(farthest: float, log_scale: float) -> Splats:
    """The model with its first primitive there, and all of one size."""
    model = foreign_model.model()
    means = model.means.copy()
    means[0, 0] = farthest
    return replace(model, means=means, log_scales=np.full_like(model.log_scales, log_scale))


def n_moved(path: Path, model: Splats) -> int:
    """How many primitives of one size are in a file by more than that away from any of its."""
    back = read_model(path).splats.means
    away = np.abs(back[:, None] - model.means[None]).max(axis=-1).min(axis=0)  # [N]
    return int((away > model.scales[:, 0]).sum())


@pytest.mark.parametrize(("farthest", "moved"), [(1000.0, 0), (1e6, foreign_model.N), (1e8, foreign_model.N)])
def test_a_primitive_far_away_that_leaves_spz_no_room_for_the_others_is_told(tmp_path, farthest, moved):
    tiny = with_one_far_away(farthest, -9)
    lost = write_model(tmp_path / "a.spz", tiny)
    assert n_moved(tmp_path / "a.spz", tiny) == moved
    said = f"SPZ has 24 bits for a coordinate: with one of {farthest:.3g} it moves {moved} primitives by more than "
    assert lost == ([said + "their size"] if moved else [])


@pytest.mark.parametrize(("suffix", "most"), [(".spz", 1), (".compressed.ply", 4), (".sog", None), (".glb", None)])
@pytest.mark.parametrize("white", [None, 2.0])
def test_sh_coefficients_that_a_format_cannot_say_are_told(tmp_path, suffix, most, white):
    model, unit = foreign_model.model(), white or 1.0
    model.sh_coeffs[:, 1:] = 0
    model.sh_coeffs[:3, 2, 1] = unit, -unit, -5 * unit
    lost = write_model(tmp_path / f"a{suffix}", Model(model, Drawing(linear=bool(white), white=white)))
    said = [f"no SH coefficients beyond ±{most * unit:.4g}, to which it clamps 1 primitive"] if most else []
    assert [line.partition(" has ")[2] for line in lost] == said
    back = read_model(tmp_path / f"a{suffix}").splats.sh_coeffs[:, 2, 1]
    assert np.abs(back).max() == pytest.approx((most or 5) * unit, rel=0.01)


@pytest.mark.parametrize(("suffix", "said"), [
    (".spz", "SPZ has no mean colour (where 1 is white) below -0.4403 or above 1.44, to which it clamps 2 primitives"),
    (".splat", ".splat has no mean colour (where 1 is white) above 1, to which it clamps 1 primitive"),
    (".sog", None), (".compressed.ply", None), (".glb", None), (".ply", None),
])  # fmt: skip
def test_mean_colours_that_a_format_cannot_say_are_told(tmp_path, suffix, said):
    """What is darker than black is black, unless something that depends on the view may lighten it."""
    model = foreign_model.model().uniform_sh(1)
    model.sh_coeffs[:] = 0
    model.sh_coeffs[:2, 0, 1] = 5, -5
    lost = write_model(tmp_path / f"a{suffix}", model)
    assert [line for line in lost if "view-dependent" not in line] == ([said] if said else [])
    back = read_model(tmp_path / f"a{suffix}")
    assert write_model(tmp_path / f"b{suffix}", back) == []
    found = 0.5 + 0.28209479 * back.splats.sh_coeffs[:, 0]
    expected = {".spz": (-0.4403, 1.4403), ".splat": (0, 1)}.get(suffix, (-0.9105, 1.9105))
    assert (found.min(), found.max()) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("farthest", [10.0, 1e4])
def test_primitives_that_compressed_ply_moves_beside_one_far_away_are_told(tmp_path, farthest):
    fine = with_one_far_away(farthest, -4)
    lost = write_model(tmp_path / "a.compressed.ply", fine)
    moved = n_moved(tmp_path / "a.compressed.ply", fine)
    said = f"with one of {farthest:.3g} it moves {moved} primitives by more than their size"
    assert [line.partition(": ")[2] for line in lost] == ([said] if moved else []) and bool(moved) == (farthest > 1e3)


@pytest.mark.parametrize("farthest", [10.0, 1e6])
def test_primitives_that_sog_moves_beside_one_far_away_are_told(tmp_path, farthest):
    small = with_one_far_away(farthest, -9)
    lost = write_model(tmp_path / "a.sog", small)
    moved = n_moved(tmp_path / "a.sog", small)
    said = f"SOG has 16 bits for the logarithm of a coordinate: with one of {farthest:.3g} it moves "
    assert lost == ([f"{said}{moved} primitives by more than their size"] if moved else [])
    assert bool(moved) == (farthest > 10)


@pytest.mark.parametrize("suffix", [".sog", ".spz", ".compressed.ply"])
def test_places_farther_apart_than_float32_can_say_are_written(tmp_path, suffix):
    model = foreign_model.model()
    means = model.means.copy()
    means[:2, 0] = 3e38, -3e38
    back = read_model(written(tmp_path / f"a{suffix}", replace(model, means=means))).splats.means[:, 0]
    farthest = 2.0**23 if suffix == ".spz" else 3e38
    assert np.sort(back)[[0, -1]] == pytest.approx([-farthest, farthest], rel=1e-2)


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("value", [1e37, float(np.finfo(np.float32).max), -float(np.finfo(np.float32).max)])
@pytest.mark.parametrize("sizes", [4, slice(None)])  # of one, and of all, by which some formats choose their grids
def test_numbers_at_the_end_of_float32_are_written_without_a_warning(tmp_path, suffix, value, sizes):
    model, path = foreign_model.model(), tmp_path / f"model{suffix}"
    before = model.opacities.copy()
    model.sh_coeffs[2], model.log_scales[sizes] = value, value
    write_model(path, model)
    assert np.allclose(np.sort(read_model(path).splats.opacities), np.sort(before), atol=1 / 255)


def test_not_antialiased_is_told_from_nothing_said(tmp_path):
    model = foreign_model.model()
    for suffix in (".ply", ".sog", ".glb", ".compressed.ply"):
        assert read_model(written(tmp_path / f"a{suffix}", model)).drawing.antialiased is None
        assert read_model(written(tmp_path / f"a{suffix}", Model(model, Drawing(False)))).drawing.antialiased is False


@pytest.mark.parametrize("suffix", [suffix for suffix in FORMATS if not FORMATS[suffix].dog])
def test_dog_is_never_lost_in_silence(tmp_path, suffix):
    with pytest.raises(DataError, match="DoG.*bake"):
        write_model(tmp_path / f"a{suffix}", random_splats(5, 1, (1,)))
    assert not list(tmp_path.iterdir())


def test_dog_and_drawing_are_in_one_ply(tmp_path):
    model = random_splats(5, 1, (1, 3))
    back = read_model(written(tmp_path / "a.ply", Model(model, EVERYTHING)))
    assert back.splats.n_dog == 2 and back.drawing == EVERYTHING
    assert np.array_equal(back.splats.dog_log_scales, model.dog_log_scales)


@pytest.mark.parametrize("suffix", FORMATS)
def test_sh_degrees_of_single_primitives_are_filled_up_unless_rows_are_asked_for(tmp_path, suffix):
    full = foreign_model.model()
    model = full.with_sh_degrees(np.arange(12) % 3)
    back = read_model(written(tmp_path / f"a{suffix}", model)).splats
    assert not back.mixed_sh and back.sh_degree == (0 if suffix == ".splat" else 2)
    if suffix in LOSSLESS:
        assert np.array_equal(back.sh_coeffs, model.uniform_sh().sh_coeffs)
    back = read_model(written(tmp_path / f"b{suffix}", model, sh_rows=True)).splats
    assert back.mixed_sh == (suffix == ".ply")
    if suffix == ".ply":
        assert np.array_equal(back.sh_degrees, model.sh_degrees)

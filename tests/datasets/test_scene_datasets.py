"""Mitsuba scenes as data sets."""


import numpy as np
import pytest
from dataset_folders import error_of
from mi_dogsplat.datasets import load_dataset
from mi_dogsplat.datasets.scene_file import has_splats, load_scene
from mi_dogsplat.support.errors import DataError
from scene_files import scene_file


def test_a_mitsuba_scene_becomes_one_view_per_sensor_in_display_values(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    dataset = load_dataset(scene_file(tmp_path), spp=4)
    assert [view.name for view in dataset.test] == ["sensor_000"]
    assert [view.name for view in dataset.train] == ["cam1", "cam2"]
    view = dataset.train[0]
    assert view.image.shape == (6, 8, 3) and not dataset.has_alpha and len(dataset.points) == 0
    srgb = 1.055 * np.array([0.5, 0.2, 0.1]) ** (1 / 2.4) - 0.055
    np.testing.assert_allclose(view.image[3, 4], srgb, atol=1e-5)
    np.testing.assert_allclose(view.camera.position, (0.1, 0, -4), atol=1e-6)


def test_a_mitsuba_film_with_alpha_gives_premultiplied_display_values_and_is_averaged_linearly(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    dataset = load_dataset(scene_file(tmp_path, "rgba"), downscale=2, spp=16)
    image = dataset.train[0].image
    assert dataset.has_alpha and image.shape == (3, 4, 4)
    edge = (image[..., 3] > 0.05) & (image[..., 3] < 0.95)
    assert edge.any()
    srgb = 1.055 * np.array([0.5, 0.2, 0.1]) ** (1 / 2.4) - 0.055
    np.testing.assert_allclose(image[edge][:, :3], image[edge][:, 3:] * srgb, atol=1e-4)


def test_a_mitsuba_scene_that_cannot_be_loaded_or_has_a_lens_is_one_line(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    file = scene_file(tmp_path)
    good = file.read_text()
    file.write_text(good[:-20])
    assert "Mitsuba cannot load it" in error_of(file)
    lens = (
        '<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="4"/><float name="fov"'
    )
    file.write_text(good.replace('"perspective"', '"thinlens"').replace('<float name="fov"', lens))
    assert "perspective" in error_of(file, spp=1)


def test_a_sensor_with_too_few_pixels_to_shrink_is_told_so(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    message = error_of(scene_file(tmp_path), downscale=500)
    assert "cannot be downscaled by 500; choose a smaller downscale factor" in message


def test_a_scene_that_is_refused_when_it_is_rendered_is_one_line(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    file = scene_file(tmp_path)
    file.write_text(file.read_text().replace('<integrator type="path">', '<integrator type="dogsplat">'))
    assert 'scene.xml: dogsplat: the scene has no shape of type "dog"; add one' in error_of(file, spp=1)


def test_a_scene_of_splats_is_no_data_set(tmp_path):
    """It is refused before its models are looked for."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    shape = '<shape type="dog"><string name="filename" value="missing.ply"/></shape>'
    (tmp_path / "s.xml").write_text(scene_file(tmp_path).read_text().replace("</scene>", f"{shape}</scene>"))
    error = error_of(tmp_path / "s.xml")
    assert "s.xml: is a scene of splats, not a data set; render it (dogsplat render)" in error


def test_files_are_found_beside_their_scene_and_not_beside_one_that_was_loaded_before(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    spectrum = '<bsdf type="diffuse"><spectrum name="reflectance" filename="a.spd"/></bsdf>'
    parts = f'<path value="sub"/><shape type="sphere">{spectrum}</shape><integrator type="path"/>'
    (tmp_path / "one" / "sub").mkdir(parents=True)
    (tmp_path / "one" / "a.spd").write_text("400 0.1\n700 0.1\n")
    file = tmp_path / "one" / "scene.xml"
    file.write_text(f'<scene version="3.0.0">{parts}</scene>')
    folders = str(mi.file_resolver())
    assert not has_splats(file)  # which reads it alone
    load_scene(file)
    assert str(mi.file_resolver()) == folders
    file = file.rename(tmp_path / "scene.xml")
    (tmp_path / "sub").mkdir()
    with pytest.raises(DataError, match="a.spd"):
        load_scene(file)

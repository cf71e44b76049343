"""Pictures without the noise of light paths."""

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import OpenEXR
import pytest
from mi_dogsplat.cli import main
from mi_dogsplat.plugin.denoising import CHANNELS
from mi_dogsplat.render import denoise
from mi_dogsplat.render.denoise import correction, denoised, parted
from mi_dogsplat.render.render_files import render_scene
from mi_dogsplat.support.errors import DataError

ROOM = """<integrator type="dogpath"/>
<shape type="dog"><string name="filename" value="{model}"/></shape>
<sensor type="perspective"><float name="fov" value="40"/>
<transform name="to_world"><lookat origin="0, -4, 1" target="0, 0, 0" up="0, 0, 1"/></transform>
<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/>{film}</film></sensor>
<shape type="rectangle"><transform name="to_world"><scale value="5"/><translate z="-0.6"/></transform></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="180"/>
<translate x="1.5" z="2"/></transform><emitter type="area"><rgb name="radiance" value="9, 8, 7"/></emitter></shape>"""


@pytest.fixture
def room(model, tmp_path) -> Any:
    def written(film="", content=ROOM) -> Path:
        path = tmp_path / "room.xml"
        path.write_text(f'<scene version="3.0.0">{content.format(model=model, film=film)}</scene>')
        return path

    return written


def loaded(path: Path) -> tuple[Any, list[str]]:
    scene: Any = mi.load_file(str(path))
    integrator: Any = scene.integrator()
    integrator.denoising = True
    return scene, integrator.aov_names()


@pytest.mark.slow
@pytest.mark.parametrize("film", ["", '<rfilter type="box"/><string name="pixel_format" value="rgba"/>'])
def test_noise_goes_and_what_splats_show_stays(room, film):
    scene, names = loaded(room(film))
    render: Any = mi.render
    truth, _ = parted(np.array(render(scene, spp=256, seed=1)), names)
    noisy = np.array(mi.render(scene, spp=8))
    before = noisy.copy()
    clean = denoised(noisy, names)
    np.testing.assert_array_equal(noisy, before)
    plain, given = parted(noisy, names)
    assert clean.shape == plain.shape == truth.shape and clean.dtype == np.float32
    errors = [float(np.abs(image - truth).mean()) for image in (plain, clean)]
    assert errors[1] < 0.4 * errors[0], errors
    unlit = (given[..., :3] <= 0).all(-1)
    dark = unlit & (np.abs(clean - plain).max(-1) > 1e-3)
    assert dark.sum() <= 0.02 * dark.size  # what is smoothed hardly runs over the edges of opaque splats
    if plain.shape[-1] == 4:
        np.testing.assert_array_equal(clean[..., 3], plain[..., 3])


def test_other_channels_stay():
    image = np.random.default_rng(0).random((20, 30, 3 + 2 + 9)).astype(np.float32)
    names = ["depth.Z", *CHANNELS, "holdout.Y"]
    plain, given = parted(image, names)
    for result in (denoised(image, names), plain):
        np.testing.assert_array_equal(result[..., 3:], image[..., [3, 13]])
    np.testing.assert_array_equal(plain[..., :3], image[..., :3])
    np.testing.assert_array_equal(given, image[..., 4:13])


def test_what_negative_lobes_take_stays():
    image = np.zeros((16, 16, 12), np.float32)
    image[..., :3], image[..., 3:6] = 0.5, -0.1
    np.testing.assert_allclose(denoised(image, CHANNELS), 0.5, atol=1e-6)


def test_nothing_is_added_where_the_result_is_not_wanted_any_more():
    given, asked = np.random.default_rng(0).random((48, 64, 9)), []

    def goes_on() -> bool:
        asked.append(True)
        return len(asked) < 5

    assert (correction(given, goes_on) == 0).all() and len(asked) >= 5
    assert np.abs(correction(given)).max() > 0.1


def test_a_render_without_its_channels_is_refused():
    with pytest.raises(ValueError, match=r'denoising.paths.R is missing; name "denoising" in the "aovs"'):
        denoised(np.zeros((4, 4, 3)), [])


# --- dogsplat render --denoise ---


def test_files_have_the_smooth_colours_and_no_more_channels(room, tmp_path):
    path = room('<string name="component_format" value="float32"/>')
    scene, names = loaded(path)
    expected = denoised(np.array(mi.render(scene, spp=4)), names)
    out = tmp_path / "out.exr"
    assert main(["render", str(path), "-o", str(out), "--spp", "4", "--denoise"]) == 0
    channels = OpenEXR.File(str(out), separate_channels=True).channels()
    assert set(channels) == {"R", "G", "B"}
    for k, name in enumerate("RGB"):
        np.testing.assert_allclose(channels[name].pixels, expected[..., k], rtol=2e-3, atol=2e-3)
    assert main(["render", str(path), "-o", str(tmp_path / "out.png"), "--spp", "4", "--denoise"]) == 0
    assert (tmp_path / "out.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("film", "integrator", "problem"),
    [
        ("", "path", "is for the integrator dogpath, and the scene has another; give the scene"),
        ('<string name="pixel_format" value="luminance"/>', "dogpath", "needs colours, but the film is luminance"),
    ],
)
def test_other_scenes_are_refused(room, tmp_path, film, integrator, problem):
    out = tmp_path / "out.exr"
    with pytest.raises(DataError, match=f"--denoise: {problem}"):
        render_scene(room(film, ROOM.replace("dogpath", integrator)), out, 1, denoise=True)
    assert not out.exists()


def test_a_model_alone_is_refused(model, tmp_path, capsys):
    assert main(["render", str(model), "-o", str(tmp_path / "out.png"), "--denoise"]) == 2
    assert "--denoise: a model has no noise; leave it out" in capsys.readouterr().err


def test_a_missing_package_is_named(room, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(denoise, "find_spec", lambda name: None)
    assert main(["render", str(room()), "-o", str(tmp_path / "out.png"), "--spp", "1", "--denoise"]) == 2
    assert "--denoise: needs the package mitsuba-oidn; pip install 'mi_dogsplat[denoise]'" in capsys.readouterr().err
    assert not (tmp_path / "out.png").exists()

"""*Denoise*: the noise of a whole scene goes, what splats show stays, and frames have the same noise."""

import math

import numpy as np
import pytest
from blender_pictures import picture
from model_files import load
from surroundings import GREY, body, camera, light, material, plane

from blender_addon import render_engine as engine

pytestmark = pytest.mark.usefixtures("by_command")


def test_noise_goes_when_the_samples_are_done(scene, model, tmp_path):
    camera(scene, (0, -5, 1.5), (math.radians(76), 0, 0))
    load(model)
    body(plane(10, location=(0, 0, -0.5)), material("ShaderNodeBsdfDiffuse", Color=GREY))
    light(scene, "AREA", (1, -1, 2), (0.4, 0.3, 0), energy=60, size=1.5)

    def seen(samples, denoise=False):
        scene.dogsplat.samples, scene.dogsplat.denoise = samples, denoise
        return picture(scene, engine.ENGINE, tmp_path)

    truth, plain, clean = seen(100), seen(4), seen(4, denoise=True)
    errors = [float(np.abs(image - truth).mean()) for image in (plain, clean)]
    assert errors[1] < 0.5 * errors[0], errors
    scene.frame_set(scene.frame_current + 1)  # in which nothing moves
    assert not np.array_equal(seen(4), plain) and np.array_equal(seen(4, denoise=True), clean)

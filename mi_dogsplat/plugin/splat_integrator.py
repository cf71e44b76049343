"""What integrators that splat have in common: passes of a render, their derivatives, the film."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from operator import index
from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

from ..engine import aovs
from ..engine.arrays import backward
from ..engine.device_camera import DeviceCamera
from ..engine.options import RasterOptions
from ..engine.parameters import concatenate
from ..engine.rasterize import LastFrame, rasterize
from ..scene.drawing import Drawing, DrawnAs
from ..scene.sh_basis import sh_degree_of
from ..shape_dog import DogShape
from . import background, denoising, surfaces
from .agreement import agreed
from .camera_masks import CHANNEL, CameraMasks
from .drawn import Drawn, Splatted, SplattedModel
from .film import develop, has_alpha, side_by_side
from .freezing import refuse_freezing
from .given_model import is_dog_shape
from .instances import warn_of_instances
from .properties import given
from .samples import MOST_PASSES, Sample, samples
from .sensor import Rectangle, SensorReader, ViewPass
from .several_passes import SeveralPasses, tangents
from .surfaces import Surfaces
from .turns import ONE_AT_A_TIME


class SplatIntegrator(ADIntegrator):
    """Draws whole images of ``dog`` shapes by splatting; ``mi.render`` in primal, forward and backward mode.

    What other shapes look like, how they show through splats, and what they do to them, is for its children to say:
    ``sees_surfaces``, ``over_surfaces`` and ``shown_params``. ``on_pass``, where it is set, is called after passes with
    the number of those that are done, and of all, if there are several. ``first_pass``, where it is set, is the number
    of the first one of renders that go on from others of the same seed: random numbers fall evenly over all. ``masks``,
    where they are set, say what the camera sees otherwise than light does, without derivatives; then the film has one
    more channel. ``picture``, where it is set, is the one of which the film shows a part, as ``SensorReader`` takes it.
    ``denoising``: whether films have the channels of ``denoising.py`` as well. ``warns``: whether Mitsuba's logger is
    told of shapes that are not drawn.
    """

    name: str  # of the plugin, in messages
    further_aovs: tuple[str, ...] = ()  # of this integrator alone

    def __init__(self, props: Any):
        super().__init__(props)
        srgb = given(props, "srgb_primitives", bool)
        linear = None if srgb is None else not srgb
        near_clip = given(props, "near_clip", float)
        if near_clip is not None and not 0 <= near_clip < math.inf:
            raise RuntimeError(f'{self.name}: "near_clip" is {near_clip}, it must be finite, 0 or more')
        self.drawing = Drawing(given(props, "antialiased", bool), near_clip, linear)
        self.hide_emitters = given(props, "hide_emitters", bool, False)
        self.negative_transmittance = given(props, "negative_transmittance", bool, True)
        self.on_pass: Any = None
        self.first_pass: int | None = None
        self.masks: CameraMasks | None = None
        self.picture: Rectangle | None = None
        self.warns = True
        self._sensors, self._last = SensorReader(), LastFrame()
        self._looked_for_unseen = False
        try:
            named = aovs.read_names(given(props, "aovs", str, ""), self.further_aovs)
        except ValueError as error:
            raise RuntimeError(f"{self.name}: {error}") from None
        self.aovs, self.denoising = [name for name in named if name in aovs.AOVS], denoising.AOV in named

    # --- what children say ---

    def averages(self, scene: mi.Scene) -> bool:
        """Whether more than one sample per pixel is of use, whatever the sensor."""
        raise NotImplementedError

    def sees_surfaces(self, scene: mi.Scene) -> bool:
        """Whether other shapes than ``dog`` are there and shown."""
        raise NotImplementedError

    def over_surfaces(self, views: Sequence[Splatted]) -> list[list]:
        """Film radiance, three channels, of each view: of splats that end at surfaces, over these and the
        background."""
        raise NotImplementedError

    def passes_at_once(self, scene: mi.Scene, model: SplattedModel, pixels: int) -> int:
        """How many passes of so many pixels are drawn together."""
        return 1

    def shown_params(self, scene: mi.Scene, model: SplattedModel, camera: DeviceCamera) -> dict:
        """Parameters of the primitives as they are seen from the place of a camera."""
        return model.params

    def warn_of_unseen(self, scene: mi.Scene) -> None:
        """Warnings of what a scene has and pictures do not show; asked once."""
        warn_of_instances(self.name, scene)

    # --- what Mitsuba calls ---

    def aov_names(self) -> list[str]:
        extra = [*([CHANNEL] if self.masks else []), *(denoising.CHANNELS if self.denoising else ())]
        return aovs.channel_names(self.aovs) + extra

    def sample(self, *args, **kwargs):
        """What an integrator that this one is nested in calls, for rays that are no longer those of an image."""
        raise RuntimeError(
            f"{self.name}: cannot be nested in another integrator, it draws whole images and not single rays; "
            'make it the integrator of the scene and name extra channels in its own "aovs"'
        )

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True) -> mi.TensorXf:
        """The image; empty, as of Mitsuba's own integrators, if not ``develop``: the film has it all the same."""
        with ONE_AT_A_TIME:
            with dr.suspend_grad():
                image = self.developed(scene, _sensor(scene, sensor), seed, spp)
            if not develop:
                return mi.TensorXf()
            if evaluate:
                dr.eval(image)
            return image

    def render_forward(self, scene, params, sensor=0, seed=0, spp=0) -> mi.TensorXf:
        sensor = _sensor(scene, sensor)
        with ONE_AT_A_TIME, dr.resume_grad():
            passes = self._passes(scene, sensor, seed, spp)
            if len(passes) == 1:
                return tangents(self.developed(scene, sensor, seed, spp, derivative=True))
            return self._several(scene, self._model(scene), sensor, passes).tangent()

    def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0) -> None:
        sensor = _sensor(scene, sensor)
        with ONE_AT_A_TIME:
            passes = self._passes(scene, sensor, seed, spp)
            with dr.resume_grad():
                if len(passes) == 1:
                    image = self.developed(scene, sensor, seed, spp, derivative=True)
                    backward([image], [grad_in])
                else:
                    model, n_planes = self._model(scene), 3 + has_alpha(sensor.film()) + len(self.aov_names())
                    self._several(scene, model, sensor, passes).backward(grad_in, n_planes, model.params)
            dr.eval()

    # --- passes ---

    def developed(self, scene: mi.Scene, sensor: mi.Sensor, seed: Any, spp: int, derivative=False) -> Any:
        """The image of the film, attached to the AD graph where the parameters are.

        ``derivative``: wanted for its graph only, of one pass, after a primal one; the film is left as it is.
        """
        passes, model = self._passes(scene, sensor, seed, spp), self._model(scene)
        if len(passes) == 1:
            (planes,) = self._images(scene, model, sensor, passes, derivative=derivative)
        else:
            planes = self._several(scene, model, sensor, passes).planes(self.on_pass)
        return develop(sensor.film(), self.aov_names(), planes, derivative)

    def _several(
        self, scene: mi.Scene, model: SplattedModel, sensor: mi.Sensor, passes: list[Sample]
    ) -> SeveralPasses:
        film, images = sensor.film(), partial(self._images, scene, model, sensor)
        together = self.passes_at_once(scene, model, dr.prod(film.crop_size()))
        return SeveralPasses(film, self.aov_names(), passes, images, together, self.denoising)

    def _passes(self, scene: mi.Scene, sensor: mi.Sensor, seed, spp: int) -> list[Sample]:
        refuse_freezing(self.name, "a render")
        spp = self._samples_per_pixel(spp) or self._usual_samples_per_pixel(scene, sensor)
        if spp > MOST_PASSES:
            raise RuntimeError(f"{self.name}: spp is {spp}, it must be at most {MOST_PASSES}; average several renders")
        if spp > 1 and "index" in self.aovs:
            raise RuntimeError(f'{self.name}: the AOV "index" has no mean over {spp} samples per pixel; use spp=1')
        number = int(seed[0] if dr.is_array_v(seed) else seed)
        if number < 0:
            raise RuntimeError(f"{self.name}: seed is {number}, it must not be negative")
        return samples(spp, number, self.first_pass)

    def _samples_per_pixel(self, spp: Any) -> int:
        """``spp`` as a render is given it; 0 asks for the usual number."""
        try:
            count = index(spp)
        except TypeError:  # as in C++, which takes the integers of NumPy, too
            raise RuntimeError(f"{self.name}: spp is {spp!r}, it must be a whole number") from None
        if count < 0:
            raise RuntimeError(f"{self.name}: spp is {count}, it must not be negative; 0 asks for that of the sampler")
        return count

    def _usual_samples_per_pixel(self, scene: mi.Scene, sensor: mi.Sensor) -> int:
        """That of the sampler, where there is something to average."""
        if not (self.averages(scene) or sensor.needs_aperture_sample()):
            return 1
        count = sensor.sampler().sample_count()
        if count == 0:
            raise RuntimeError(f'{self.name}: the "sample_count" of the sampler is 0; give it, or spp, 1 or more')
        return count

    def _images(
        self, scene: mi.Scene, model: SplattedModel, sensor: mi.Sensor, passes: list[Sample], border: int = 0,
        derivative: bool = False,
    ) -> list[list[mi.Float]]:  # fmt: skip
        """Of each pass, planes of the film's channels at its samples; ``derivative`` as in ``developed``."""
        views = self._sensors.views(sensor, model.drawn_as.near_clip, self.picture)
        fixed = [None if view.lens else self.shown_params(scene, model, view.camera) for view in views]
        splatted = []
        for sample in passes:
            for view, params in zip(views, fixed, strict=True):
                view_pass = view.through(sample, border)
                params = self.shown_params(scene, model, view_pass.camera) if params is None else params
                splatted.append(self._splatted(scene, model, params, view_pass, derivative, len(views) == 1))
        shown = zip(splatted, self._colors(splatted), strict=True)
        planes = [self._channels(view, colors, sensor.film()) for view, colors in shown]
        camera = splatted[0].drawn.view_pass.camera
        n = len(views)
        return [side_by_side(planes[k : k + n], camera.width, camera.height) for k in range(0, len(planes), n)]

    # --- a view of a pass ---

    def drawn_as(self, scene: mi.Scene) -> DrawnAs:
        """How it draws the ``dog`` shapes of a scene. Raises ``RuntimeError`` where their files disagree."""
        return agreed(self.drawing, dog_shapes(scene))

    def _model(self, scene: mi.Scene) -> SplattedModel:
        shapes = dog_shapes(scene)
        if self.warns and not self._looked_for_unseen:
            self._looked_for_unseen = True
            self.warn_of_unseen(scene)
        if not shapes:
            raise RuntimeError(f'{self.name}: the scene has no shape of type "dog"; add one')
        params, sh_size = concatenate([s.parameters for s in shapes], [s.sh_size for s in shapes])
        return SplattedModel(params, sh_degree_of(sh_size), self.drawn_as(scene))

    def _splatted(
        self, scene: mi.Scene, model: SplattedModel, params: dict, view_pass: ViewPass, derivative: bool, alone: bool
    ) -> Splatted:
        """A view of ``params``; ``alone``: there is no other one in the pass, so that its stages are the latest."""
        drawn_as = model.drawn_as
        options = RasterOptions(
            sh_degree=model.sh_degree,
            antialiased=drawn_as.antialiased,
            negative_transmittance=self.negative_transmittance,
        )
        drawn = Drawn(scene, view_pass, params, aovs.options_for(self.aovs, options), drawn_as.linear, derivative)
        seen = self._surfaces(scene, view_pass)
        last = None if seen else self._last  # it does not know depths from before
        stop_depth = seen.depth if seen else None
        if self.masks:
            frame = self.masks.frame(drawn, seen)
        else:
            frame = rasterize(
                params, view_pass.camera, drawn.options, last=last, recall=derivative and alone, stop_depth=stop_depth,
                one_of_many=derivative and view_pass.sample.number is not None,
            )  # fmt: skip
        return Splatted(drawn, frame, seen)

    def _colors(self, views: list[Splatted]) -> list[list]:
        """Film radiance of each, three channels. Surfaces are seen in all of them, or in none."""
        if views[0].surfaces:
            return self.over_surfaces(views)
        return [
            view.drawn.decoded(self.over_background(view.frame.colors, view.frame.T, view.drawn)) for view in views
        ]

    def _channels(self, view: Splatted, colors: list, film: mi.Film) -> list[mi.Float]:
        """Planes of the film's channels."""
        drawn, seen, frame = view.drawn, view.surfaces, view.frame
        if seen:
            frame = seen.behind(frame)
        if mi.is_monochromatic:
            colors = [mi.luminance(mi.Color3f(colors))] * 3
        alpha, found = [1 - frame.T] if has_alpha(film) else [], aovs.channels(self.aovs, frame, drawn.derivative)
        extra = dict(zip(aovs.channel_names(self.aovs), found, strict=True))
        if drawn.hole is not None:
            extra[CHANNEL] = drawn.hole
        if self.denoising:
            found = seen.for_denoiser if seen and seen.for_denoiser else denoising.nothing(dr.width(frame.T))
            extra |= dict(zip(denoising.CHANNELS, found, strict=True))
        if seen and "median_depth.Z" in extra:
            extra["median_depth.Z"] = seen.median_depth(extra["median_depth.Z"])
        return [*colors, *alpha, *extra.values()]

    def _surfaces(self, scene: mi.Scene, view_pass: ViewPass) -> Surfaces | None:
        """What the rays of a pass meet, as the camera sees it; None where no surfaces are seen."""
        if not self.sees_surfaces(scene):
            return None
        lamps = self.masks.lamps if self.masks else surfaces.emits
        passed = lamps if self.hidden_lights() else None
        passed = self.masks.passed(passed) if self.masks else passed
        return surfaces.meet(scene, view_pass, normal="normal" in self.aovs, passed=passed)

    def hidden_lights(self) -> bool:
        """Whether rays of the camera pass through emitters that are shapes."""
        return self.hide_emitters

    def over_background(self, colors: list, T: mi.Float, drawn: Drawn) -> list:
        """Splats over the environment emitter, blended in the primitives' colour space."""
        environment = drawn.scene.environment()
        if environment is None or self.hide_emitters:
            return colors
        behind = drawn.encoded(background.radiance(environment, drawn.view_pass.rays()))
        return [dr.fma(T, b, c) for c, b in zip(colors, behind, strict=True)]

    def to_string(self) -> str:
        said = "".join(f"  {name} = {value},\n" for name, value in self.drawing.said().items())
        return f"{type(self).__name__}[\n{said}  aovs = {self.aovs}\n]"


def dog_shapes(scene: mi.Scene) -> list[DogShape]:
    """The ``dog`` shapes of a scene, in the order of their ids.

    Mitsuba's own order changes from load to load, and with it would who is in front where primitives have one depth.
    """
    return sorted((shape for shape in scene.shapes() if is_dog_shape(shape)), key=lambda shape: shape.id())


def _sensor(scene: mi.Scene, sensor: mi.Sensor | int) -> mi.Sensor:
    return scene.sensors()[sensor] if isinstance(sensor, int) else sensor

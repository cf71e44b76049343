"""What integrators that splat have in common: passes of a render, their derivatives, the film."""

from __future__ import annotations

import math
from operator import index
from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

from ..engine import aovs
from ..engine.arrays import backward
from ..engine.options import RasterOptions
from ..engine.parameters import concatenate
from ..engine.rasterize import Frame, LastFrame, rasterize
from ..scene.drawing import Drawing, DrawnAs
from ..scene.sh_basis import sh_degree_of
from ..shape_dog import DogShape
from . import background, denoising, surfaces
from .agreement import agreed
from .camera_masks import CHANNEL, CameraMasks
from .drawn import Drawn, SplattedModel
from .film import develop, has_alpha, side_by_side
from .filter import Filter, normalized
from .freezing import refuse_freezing
from .given_model import is_dog_shape
from .instances import warn_of_instances
from .properties import given
from .samples import Sample, samples
from .sensor import SensorReader, ViewPass
from .surfaces import Surfaces
from .turns import ONE_AT_A_TIME


class SplatIntegrator(ADIntegrator):
    """Draws whole images of ``dog`` shapes by splatting; ``mi.render`` in primal, forward and backward mode.

    What other shapes look like, how they show through splats, and what they do to them, is for its children to say:
    ``sees_surfaces``, ``over_surfaces`` and ``shown_params``. ``on_pass``, where it is set, is called after each of
    several passes with the number of those that are done, and of all. ``first_pass``, where it is set, is the number of
    the first one of renders that go on from others of the same seed: random numbers fall evenly over all. ``masks``,
    where they are set, say what the camera sees otherwise than light does, without derivatives; then the film has one
    more channel. ``denoising``: whether films have the channels of ``denoising.py`` as well. ``warns``: whether
    Mitsuba's logger is told of shapes that are not drawn.
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

    def over_surfaces(self, frame: Frame, seen: Surfaces, drawn: Drawn) -> list:
        """Film radiance, three channels, of splats that end at surfaces, over these and the background."""
        raise NotImplementedError

    def shown_params(self, scene: mi.Scene, model: SplattedModel, view_pass: ViewPass) -> dict:
        """Parameters of the primitives as a view shows them."""
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
        with ONE_AT_A_TIME, dr.resume_grad():
            image = self.developed(scene, _sensor(scene, sensor), seed, spp, derivative=True)
            # the tangent of what a parameter was computed to stays for the next render of the same graph
            dr.forward_to(image, flags=dr.ADFlag.ClearEdges | dr.ADFlag.AllowNoGrad)
            return dr.grad(image)

    def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0) -> None:
        sensor = _sensor(scene, sensor)
        with ONE_AT_A_TIME:
            passes = self._passes(scene, sensor, seed, spp)
            with dr.resume_grad():
                if len(passes) == 1:
                    image = self.developed(scene, sensor, seed, spp, derivative=True)
                    backward([image], [grad_in])
                else:
                    self._backward_by_passes(scene, sensor, passes, grad_in)
            dr.eval()

    # --- passes ---

    def _backward_by_passes(self, scene, sensor, passes: list[Sample], grad_in) -> None:
        """One pass after the other, so that memory does not grow with their number: their mean is linear in them."""
        film = sensor.film()
        pixel_filter, pixels = Filter(film, self.denoising), dr.prod(film.crop_size())
        passes = pixel_filter.places(passes)
        n_planes = 3 + has_alpha(film) + len(self.aov_names())
        planes = [dr.zeros(mi.Float, pixels) for _ in range(n_planes)]
        dr.enable_grad(planes)
        backward([develop(film, self.aov_names(), planes, derivative=True)], [grad_in])
        weights = sum(pixel_filter.spread([], sample)[0] for sample in passes)
        adjoints = [dr.select(weights != 0, dr.grad(plane) / weights, 0) for plane in planes]
        dr.eval(adjoints)
        model = self._model(scene)
        for sample in passes:
            with dr.isolate_grad():  # what all passes share is derived once, at the end
                values = self._pass(scene, model, sensor, sample, pixel_filter.border, derivative=True)
                sums = pixel_filter.spread(values, sample)
                backward(sums[:-1], adjoints)

    def developed(self, scene: mi.Scene, sensor: mi.Sensor, seed: Any, spp: int, derivative=False) -> Any:
        """The image of the film, attached to the AD graph where the parameters are.

        ``derivative``: wanted for its graph only, after a primal pass; the film is left as it is.
        """
        passes, film, model = self._passes(scene, sensor, seed, spp), sensor.film(), self._model(scene)
        if len(passes) == 1:
            planes = self._pass(scene, model, sensor, passes[0], derivative=derivative)
        else:
            pixel_filter, sums = Filter(film, self.denoising), []
            for done, sample in enumerate(pixel_filter.places(passes), 1):
                values = self._pass(scene, model, sensor, sample, pixel_filter.border, derivative)
                new = pixel_filter.spread(values, sample)
                sums = [a + b for a, b in zip(sums, new, strict=True)] if sums else new
                dr.eval(sums)
                if self.on_pass:
                    dr.sync_thread()
                    self.on_pass(done, len(passes))
            planes = normalized(sums)
        return develop(film, self.aov_names(), planes, derivative)

    def _passes(self, scene: mi.Scene, sensor: mi.Sensor, seed, spp: int) -> list[Sample]:
        refuse_freezing(self.name, "a render")
        try:
            spp = index(spp)
        except TypeError:  # as in C++, which takes the integers of NumPy, too
            raise RuntimeError(f"{self.name}: spp is {spp!r}, it must be a whole number") from None
        if spp < 0:
            raise RuntimeError(f"{self.name}: spp is {spp}, it must not be negative; 0 asks for that of the sampler")
        if spp == 0:
            averages = self.averages(scene) or sensor.needs_aperture_sample()
            spp = sensor.sampler().sample_count() if averages else 1
        if spp > 1 and "index" in self.aovs:
            raise RuntimeError(f'{self.name}: the AOV "index" has no mean over {spp} samples per pixel; use spp=1')
        return samples(spp, int(seed[0] if dr.is_array_v(seed) else seed), self.first_pass)

    def _pass(
        self, scene: mi.Scene, model: SplattedModel, sensor: mi.Sensor, sample: Sample, border: int = 0,
        derivative: bool = False,
    ) -> list[mi.Float]:  # fmt: skip
        """Planes of the film's channels at the samples of one pass; ``derivative`` as in ``developed``."""
        views = self._sensors.views(sensor, model.drawn_as.near_clip)
        passes, alone = [view.through(sample, border) for view in views], len(views) == 1
        images = [self._planes(scene, model, sensor.film(), one, derivative, alone) for one in passes]
        return side_by_side(images, passes[0].camera.width, passes[0].camera.height)

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
            raise RuntimeError(f'{self.name}: the scene has no shape of type "dog"')
        params, sh_size = concatenate([s.parameters for s in shapes], [s.sh_size for s in shapes])
        return SplattedModel(params, sh_degree_of(sh_size), self.drawn_as(scene))

    def _planes(
        self, scene: mi.Scene, model: SplattedModel, film: mi.Film, view_pass: ViewPass, derivative: bool, alone: bool
    ) -> list[mi.Float]:
        """Planes of a view; ``alone``: there is no other one in the pass, so that its stages are the latest."""
        params, drawn_as = self.shown_params(scene, model, view_pass), model.drawn_as
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
            frame = rasterize(params, view_pass.camera, drawn.options, None, last, derivative and alone, stop_depth)
        colors: list
        if seen:
            colors = self.over_surfaces(frame, seen, drawn)
            frame = seen.behind(frame)
        else:
            colors = drawn.decoded(self.over_background(frame.colors, frame.T, drawn))
        if mi.is_monochromatic:
            colors = [mi.luminance(mi.Color3f(colors))] * 3
        alpha = [1 - frame.T] if has_alpha(film) else []
        extra = dict(zip(aovs.channel_names(self.aovs), aovs.channels(self.aovs, frame, derivative), strict=True))
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

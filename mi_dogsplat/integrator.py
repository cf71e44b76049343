"""Integrator plugin ``dogsplat``: renders ``dog`` shapes by splatting."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

from .engine import aovs
from .engine.parameters import concatenate
from .engine.rasterize import Frame, LastFrame, RasterOptions, rasterize
from .plugin import background, surfaces
from .plugin.agreement import agreed
from .plugin.film import Filter, develop, has_alpha, normalized, side_by_side
from .plugin.samples import Sample, samples
from .plugin.sensor import Look, SensorReader
from .plugin.transfer import linear_to_srgb, srgb_to_linear
from .scene.drawing import Drawing, DrawnAs
from .shape_dog import DogShape


class DogSplatIntegrator(ADIntegrator):
    """.. _integrator-dogsplat:

    Gaussian and DoG splatting (:monosp:`dogsplat`)
    -----------------------------------------------

    .. pluginparameters::

     * - srgb_primitives
       - |bool|
       - The primitives hold display-referred sRGB colours, as models trained from photographs do: the blended image
         is converted to linear radiance for the film. (Default: as the files of the shapes say, else true)

     * - antialiased
       - |bool|
       - Scale opacities by the area that the screen-space low-pass filter adds. (Default: as the files of the shapes
         say, else false)

     * - near_clip
       - |float|
       - Primitives whose centre is nearer than this to the camera plane are dropped. (Default: as the files of the
         shapes say, else 0.2, as in 3DGS)

     * - hide_emitters
       - |bool|
       - Do not show the environment behind the splats; surfaces are lit by it all the same. (Default: false)

     * - negative_transmittance
       - |bool|
       - Where a DoG primitive's weight is negative it amplifies what lies behind, T (1 - α) with α < 0; if
         false it only subtracts its own colour. (Default: true)

     * - (Nested plugin)
       - :paramtype:`integrator`
       - Renders the other shapes of the scene, e.g. ``path``. Splats are blended in front of them, pixel by pixel.
         (Default: none, other shapes are not seen)

     * - aovs
       - |string|
       - Comma-separated list of extra channels, defined in ``aovs.py``: ``alpha``, ``depth`` (expected depth along
         the optical axis, divided by alpha) and ``normal`` (world space), which are differentiable; ``median_depth``,
         ``index``, ``count`` and ``dog_share``, which are not. (Default: none)

    This integrator evaluates every ``dog`` shape of the scene by elliptical weighted averaging (Kerbl et al. 2023):
    primitives are sorted by the depth of their centres and blended per pixel. The colour of a constant or environment
    emitter of the scene shows behind them. Sensors: ``perspective``, ``thinlens``, ``orthographic``, ``batch``.

    **Samples per pixel.** A sample is one pass of splatting. ``spp=1`` evaluates the pixel centres and uses no
    reconstruction filter: splats are low-pass filtered already. ``spp=n`` renders n passes, moved inside the pixels,
    and over the lens of a ``thinlens``, so that they cover both evenly; the film's filter weighs them, and the
    seed moves them. ``spp=0``, the default, is 1, but the sample count of the sensor's sampler where there is
    something to average: a lens, or surfaces.

    **Surfaces.** A primitive is seen if its centre is nearer than the surface at that pixel. Splats neither cast
    shadows on surfaces nor show in their reflections, what is seen through a transparent surface has no splats, and
    derivatives take surfaces as constant. In AOVs a surface is opaque and the last of all: alpha is 1, depths and
    normal count it in; the other AOVs are those of the primitives in front of it.

    **Clipping.** The near clip of the sensor holds as well as that of the integrator; primitives whose centre is beyond
    its far clip are dropped, unless that is 10,000, the default of Mitsuba.

    All three modes of ``mi.render()`` are supported: primal, forward and backward. It draws whole images, not rays,
    and so cannot be nested in another integrator such as ``aov`` or ``moment``.

    .. code-block:: python

        'type': 'dogsplat',
        'surfaces': {'type': 'path'}
    """

    def __init__(self, props: Any):
        super().__init__(props)
        linear = not props["srgb_primitives"] if "srgb_primitives" in props else None
        self.drawing = Drawing(props.get("antialiased"), props.get("near_clip"), linear)
        self.hide_emitters = props.get("hide_emitters", False)
        self.negative_transmittance = props.get("negative_transmittance", True)
        objects = [props[name] for name in props.keys() if props.type(name) == mi.Properties.Type.Object]
        nested = [value for value in objects if isinstance(value, mi.Integrator)]
        if len(nested) > 1:
            raise RuntimeError(f"dogsplat: {len(nested)} nested integrators; one renders all surfaces")
        self.nested = nested[0] if nested else None
        self._sensors, self._last, self._warned = SensorReader(), LastFrame(), False
        try:
            self.aovs = aovs.read_names(props.get("aovs", ""))
        except ValueError as error:
            raise RuntimeError(f"dogsplat: {error}") from None
        if self.drawing.near_clip is not None and self.drawing.near_clip < 0:
            raise RuntimeError(f'dogsplat: "near_clip" is {self.drawing.near_clip}, it must not be negative')

    def aov_names(self) -> list[str]:
        return aovs.channel_names(self.aovs)

    def drawn_as(self, scene: mi.Scene) -> DrawnAs:
        """How it draws the ``dog`` shapes of a scene. Raises ``RuntimeError`` where their files disagree."""
        return agreed(self.drawing, _dog_shapes(scene))

    def sample(self, *args, **kwargs):
        """What an integrator that this one is nested in calls, for rays that are no longer those of an image."""
        raise RuntimeError(
            "dogsplat: cannot be nested in another integrator, it draws whole images and not single rays; "
            'make it the integrator of the scene and name extra channels in its own "aovs"'
        )

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True) -> mi.TensorXf:
        """The image; empty, as of Mitsuba's own integrators, if not ``develop``: the film has it all the same."""
        with dr.suspend_grad():
            image = self._image(scene, _sensor(scene, sensor), seed, spp)
        if not develop:
            return mi.TensorXf()
        if evaluate:
            dr.eval(image)
        return image

    def render_forward(self, scene, params, sensor=0, seed=0, spp=0) -> mi.TensorXf:
        with dr.resume_grad():
            image = self._image(scene, _sensor(scene, sensor), seed, spp, derivative=True)
            dr.forward_to(image)
            return dr.grad(image)

    def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0) -> None:
        sensor = _sensor(scene, sensor)
        passes, film = self._passes(sensor, seed, spp), sensor.film()
        with dr.resume_grad():
            if len(passes) == 1:
                image = self._image(scene, sensor, seed, spp, derivative=True)
                _backward([image], [grad_in])
            else:
                self._backward_by_passes(scene, sensor, passes, film, grad_in)
        dr.eval()

    def _backward_by_passes(self, scene, sensor, passes: list[Sample], film: mi.Film, grad_in) -> None:
        """One pass after the other, so that memory does not grow with their number: their mean is linear in them."""
        spreader, pixels = Filter(film), dr.prod(film.crop_size())
        n_planes = 3 + has_alpha(film) + len(self.aov_names())
        planes = [dr.zeros(mi.Float, pixels) for _ in range(n_planes)]
        dr.enable_grad(planes)
        _backward([develop(film, self.aov_names(), planes, derivative=True)], [grad_in])
        weights = sum(spreader.spread([], sample)[0] for sample in passes)
        adjoints = [dr.select(weights != 0, dr.grad(plane) / weights, 0) for plane in planes]
        dr.eval(adjoints)
        for sample in passes:
            with dr.isolate_grad():  # what all passes share is derived once, at the end
                sums = spreader.spread(self._pass(scene, sensor, sample, spreader.border, derivative=True), sample)
                _backward(sums[:-1], adjoints)

    def _image(self, scene: mi.Scene, sensor: mi.Sensor, seed: Any, spp: int, derivative=False) -> Any:
        """The developed film, attached to the AD graph where the parameters are.

        ``derivative``: wanted for its graph only, after a primal pass; the film is left as it is.
        """
        passes, film = self._passes(sensor, seed, spp), sensor.film()
        if len(passes) == 1:
            planes = self._pass(scene, sensor, passes[0], derivative=derivative)
        else:
            spreader, sums = Filter(film), []
            for sample in passes:
                new = spreader.spread(self._pass(scene, sensor, sample, spreader.border, derivative), sample)
                sums = [a + b for a, b in zip(sums, new, strict=True)] if sums else new
                dr.eval(sums)
            planes = normalized(sums)
        return develop(film, self.aov_names(), planes, derivative)

    def _passes(self, sensor: mi.Sensor, seed, spp: int) -> list[Sample]:
        if spp == 0:
            averages = self.nested is not None or sensor.needs_aperture_sample()
            spp = sensor.sampler().sample_count() if averages else 1
        if spp > 1 and "index" in self.aovs:
            raise RuntimeError(f'dogsplat: the AOV "index" has no mean over {spp} samples per pixel; use spp=1')
        return samples(spp, int(seed[0]) if dr.is_array_v(seed) else seed)

    def _pass(self, scene: mi.Scene, sensor: mi.Sensor, sample: Sample, border: int = 0, derivative=False) -> list:
        """Planes of the film's channels at the samples of one pass; ``derivative`` as in ``_image``."""
        drawn = self.drawn_as(scene)
        views = self._sensors.views(sensor, drawn.near_clip)
        looks = [view.through(sample, border) for view in views]
        images = [self._planes(scene, sensor.film(), look, drawn, derivative, len(views) == 1) for look in looks]
        return side_by_side(images, looks[0].camera.width, looks[0].camera.height)

    def _planes(
        self, scene: mi.Scene, film: mi.Film, look: Look, drawn: DrawnAs, derivative: bool, alone: bool
    ) -> list[mi.Float]:
        shapes = _dog_shapes(scene)
        if not shapes:
            raise RuntimeError('dogsplat: the scene has no shape of type "dog"')
        params, sh_size = concatenate([s.parameters for s in shapes], [s.sh_size for s in shapes])
        options = RasterOptions(
            sh_degree=(1, 4, 9, 16).index(sh_size),
            antialiased=drawn.antialiased,
            negative_transmittance=self.negative_transmittance,
        )
        options = aovs.options_for(self.aovs, options)
        others = len(scene.shapes()) - len(shapes)
        if others and self.nested is None and not self._warned:
            log: Any = mi.Log
            log(mi.LogLevel.Warn, f"dogsplat: {others} other shapes are not seen; nest an integrator, such as path")
            self._warned = True
        seen = None
        if self.nested is not None and others:
            seen = surfaces.trace(self.nested, scene, look, normal="normal" in self.aovs)
        last = None if seen else self._last  # it does not know depths from before
        stop_depth = seen.depth if seen else None
        frame = rasterize(params, look.camera, options, None, last, derivative and alone, stop_depth)
        if seen:
            frame = seen.behind(frame, _encoded(seen.colors, drawn))

        colors = self._over_background(frame, scene, look, drawn)
        alpha = [1 - frame.T] if has_alpha(film) else []
        extra = dict(zip(self.aov_names(), aovs.channels(self.aovs, frame, derivative), strict=True))
        if seen and "median_depth.Z" in extra:
            extra["median_depth.Z"] = seen.median_depth(extra["median_depth.Z"])
        return [*colors, *alpha, *extra.values()]

    def _over_background(self, frame: Frame, scene: mi.Scene, look: Look, drawn: DrawnAs) -> list:
        """Film radiance per channel: splats over the environment emitter, blended in the primitives' colour space."""
        colors = frame.colors
        environment = scene.environment()
        if environment is not None and not self.hide_emitters:
            behind = _encoded(background.radiance(environment, look.rays()), drawn)
            colors = [dr.fma(frame.T, b, c) for c, b in zip(colors, behind, strict=True)]
        if not drawn.linear:
            colors = srgb_to_linear(colors)
        return [mi.luminance(mi.Color3f(colors))] * 3 if mi.is_monochromatic else colors

    def to_string(self) -> str:
        said = "".join(f"  {name} = {value},\n" for name, value in self.drawing.said().items())
        return f"DogSplatIntegrator[\n{said}  aovs = {self.aovs}\n]"


def _dog_shapes(scene: mi.Scene) -> list[DogShape]:
    return [shape for shape in scene.shapes() if isinstance(shape, DogShape)]


def _encoded(radiance: list[mi.Float], drawn: DrawnAs) -> list[mi.Float]:
    """Radiance in the primitives' colour space."""
    return radiance if drawn.linear else linear_to_srgb(radiance)


def _sensor(scene: mi.Scene, sensor: mi.Sensor | int) -> mi.Sensor:
    return scene.sensors()[sensor] if isinstance(sensor, int) else sensor


def _backward(values: list, adjoints: list) -> None:
    """Accumulate the gradients of all that ``values`` depend on."""
    for value, adjoint in zip(values, adjoints, strict=True):
        dr.set_grad(value, adjoint)
    dr.enqueue(dr.ADMode.Backward, values)
    dr.traverse(dr.ADMode.Backward)


mi.register_integrator("dogsplat", lambda props: DogSplatIntegrator(props))

"""Integrator plugin ``dogsplat``: renders ``dog`` shapes by splatting."""

# The stubs of Mitsuba give properties as "object": argument checks are off here.
# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
# pyright: reportOperatorIssue=false, reportReturnType=false
from __future__ import annotations

import drjit as dr
import mitsuba as mi
from mitsuba.python.ad.integrators.common import ADIntegrator

from . import aovs
from .parameters import concatenate
from .rasterize import LastFrame, RasterOptions, rasterize
from .sensor import SensorReader
from .shape_dog import DogShape


class DogSplatIntegrator(ADIntegrator):
    """.. _integrator-dogsplat:

    Gaussian and DoG splatting (:monosp:`dogsplat`)
    -----------------------------------------------

    .. pluginparameters::

     * - srgb_primitives
       - |bool|
       - The primitives hold display-referred sRGB colours, as models trained from photographs do: the blended image
         is converted to linear radiance for the film. (Default: true)

     * - antialiased
       - |bool|
       - Scale opacities by the area that the screen-space low-pass filter adds. (Default: false)

     * - near_clip
       - |float|
       - Primitives whose centre is nearer than this to the camera plane are dropped. (Default: 0.2, as in 3DGS)

     * - negative_transmittance
       - |bool|
       - Where a DoG primitive's weight is negative it amplifies what lies behind, T (1 - α) with α < 0; if
         false it only subtracts its own colour. (Default: true)

     * - aovs
       - |string|
       - Comma-separated list of extra channels, defined in ``aovs.py``: ``alpha``, ``depth`` (expected depth along
         the optical axis, divided by alpha) and ``normal`` (world space), which are differentiable; ``median_depth``,
         ``index``, ``count`` and ``dog_share``, which are not. (Default: none)

    This integrator evaluates every ``dog`` shape of the scene by elliptical weighted averaging (Kerbl et al. 2023):
    primitives are sorted by the depth of their centres and blended per pixel. The colour of a constant or environment
    emitter of the scene shows behind them. It renders one sample per pixel at the pixel centres (splats are low-pass
    filtered already) and ignores the film's reconstruction filter, ``spp`` and the seed.

    All three modes of ``mi.render()`` are supported: primal, forward and backward. It draws whole images, not rays,
    and so cannot be nested in another integrator such as ``aov`` or ``moment``.

    .. code-block:: python

        'type': 'dogsplat',
        'srgb_primitives': True
    """

    def __init__(self, props: mi.Properties):
        super().__init__(props)
        self.srgb_primitives = props.get("srgb_primitives", True)
        self.antialiased = props.get("antialiased", False)
        self.near_clip = props.get("near_clip", 0.2)
        self.negative_transmittance = props.get("negative_transmittance", True)
        self._sensors, self._last = SensorReader(), LastFrame()
        try:
            self.aovs = aovs.read_names(props.get("aovs", ""))
        except ValueError as error:
            raise RuntimeError(f"dogsplat: {error}") from None
        if self.near_clip < 0:
            raise RuntimeError(f'dogsplat: "near_clip" is {self.near_clip}, it must not be negative')

    def aov_names(self) -> list[str]:
        return aovs.channel_names(self.aovs)

    def sample(self, *args, **kwargs):
        """What an integrator that this one is nested in calls, for rays that are no longer those of an image."""
        raise RuntimeError(
            "dogsplat: cannot be nested in another integrator, it draws whole images and not single rays; "
            'make it the integrator of the scene and name extra channels in its own "aovs"'
        )

    def render(self, scene, sensor=0, seed=0, spp=0, develop=True, evaluate=True) -> mi.TensorXf | None:
        with dr.suspend_grad():
            image = self._image(scene, sensor)
        if not develop:
            return None
        if evaluate:
            dr.eval(image)
        return image

    def render_forward(self, scene, params, sensor=0, seed=0, spp=0) -> mi.TensorXf:
        with dr.resume_grad():
            image = self._image(scene, sensor, derivative=True)
            dr.forward_to(image)
            return dr.grad(image)

    def render_backward(self, scene, params, grad_in, sensor=0, seed=0, spp=0) -> None:
        with dr.resume_grad():
            image = self._image(scene, sensor, derivative=True)
            dr.set_grad(image, grad_in)
            dr.enqueue(dr.ADMode.Backward, image)
            dr.traverse(dr.ADMode.Backward)
        dr.eval()

    def _image(self, scene: mi.Scene, sensor: mi.Sensor | int, derivative: bool = False) -> mi.TensorXf:
        """The developed film, attached to the AD graph where the parameters are.

        ``derivative``: wanted for its graph only, after a primal pass; the film is left as it is where possible.
        """
        if isinstance(sensor, int):
            sensor = scene.sensors()[sensor]
        camera = self._sensors.read(sensor, self.near_clip)
        shapes = [shape for shape in scene.shapes() if isinstance(shape, DogShape)]
        if not shapes:
            raise RuntimeError('dogsplat: the scene has no shape of type "dog"')
        params, sh_size = concatenate([s.parameters for s in shapes], [s.sh_size for s in shapes])
        options = RasterOptions(
            sh_degree=(1, 4, 9, 16).index(sh_size),
            antialiased=self.antialiased,
            negative_transmittance=self.negative_transmittance,
        )
        options = aovs.options_for(self.aovs, options)
        frame = rasterize(params, camera, options, last=self._last, recall=derivative)

        colors = self._over_background(frame, scene, sensor)
        film = sensor.film()
        has_alpha = mi.has_flag(film.flags(), mi.FilmFlags.Alpha)
        colors = [*colors, *([1 - frame.T] if has_alpha else [])]
        graph_only = derivative and _develops_unchanged(film)
        extra = aovs.channels(self.aovs, frame, graph_only)
        if graph_only:
            return _interleave(colors + extra, camera.height, camera.width)
        film.prepare(self.aov_names())
        channels = [*colors, mi.Float(1), *extra]
        film.put_block(mi.ImageBlock(_interleave(channels, camera.height, camera.width), film.crop_offset()))
        return film.develop()

    def _over_background(self, frame, scene: mi.Scene, sensor: mi.Sensor) -> list[mi.Float]:
        """Film radiance per channel: splats over the environment emitter, blended in the primitives' colour space."""
        colors = frame.colors
        environment = scene.environment()
        if environment is not None:
            behind = _environment_radiance(environment, scene, sensor)
            if self.srgb_primitives:
                behind = [mi.math.linear_to_srgb(b) for b in behind]
            colors = [dr.fma(frame.T, b, c) for c, b in zip(colors, behind, strict=True)]
        return [mi.math.srgb_to_linear(c) for c in colors] if self.srgb_primitives else colors

    def to_string(self) -> str:
        return (
            f"DogSplatIntegrator[\n  srgb_primitives = {self.srgb_primitives},\n  antialiased = {self.antialiased},\n"
            f"  near_clip = {self.near_clip},\n  aovs = {self.aovs}\n]"
        )


def _develops_unchanged(film: mi.Film) -> bool:
    """Whether the developed image of samples of weight 1 is these samples: no conversion to differentiate."""
    description = str(film)
    return description.startswith("HDRFilm[") and any(f"pixel_format = {f}," in description for f in ("rgb", "rgba"))


def _interleave(channels: list[mi.Float], height: int, width: int) -> mi.TensorXf:
    """Planes to a [height, width, channels] tensor. Differentiable."""
    n, k = height * width, len(channels)
    if n == 0:
        return dr.zeros(mi.TensorXf, (height, width, k))
    pixels = dr.empty(mi.Float, n * k)
    index = dr.arange(mi.UInt32, n)
    for c, channel in enumerate(channels):
        dr.scatter(pixels, channel, dr.fma(index, k, c), mode=dr.ReduceMode.Permute)
    return mi.TensorXf(pixels, shape=(height, width, k))


def _environment_radiance(environment: mi.Emitter, scene: mi.Scene, sensor: mi.Sensor) -> list[mi.Float]:
    """Radiance of the emitter in the direction of each pixel centre."""
    size = sensor.film().crop_size()
    index = dr.arange(mi.UInt32, size[0] * size[1])
    y = index // size[0]
    position = mi.Point2f(mi.Float(index - y * size[0]) + 0.5, mi.Float(y) + 0.5) / mi.ScalarVector2f(size)
    ray, _ = sensor.sample_ray(0, 0, position, 0)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(index))
    si.wi = -ray.d
    si.wavelengths = ray.wavelengths
    radiance = environment.eval(si)
    return list(radiance)


mi.register_integrator("dogsplat", lambda props: DogSplatIntegrator(props))

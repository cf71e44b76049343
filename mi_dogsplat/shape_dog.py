"""Shape plugin ``dog``: a cloud of Gaussian and Difference-of-Gaussians primitives."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from .engine.motion import moved
from .engine.parameters import RAW, device_array, device_tensor, rows_of_splats
from .engine.sh_groups import padded_on_device
from .plugin.freezing import refuse_freezing
from .plugin.given_model import given_model, on_host
from .plugin.properties import matrix_of
from .plugin.shape_checks import require_index, require_one_degree, require_rows, require_sh_size
from .scene.row_groups import BESIDE_COLORS, DOG, GROUPS, NAMED, SH, SHIFTS, RowGroup
from .scene.shifts import box_of_places
from .scene.splats import Splats
from .scene.transform import decompose_similarity, mean_scale, transformed


class DogShape(mi.Mesh):
    """.. _shape-dog:

    Gaussian and Difference-of-Gaussians primitives (:monosp:`dog`)
    ---------------------------------------------------------------

    .. pluginparameters::

     * - filename
       - |string|
       - Model: PLY (with an element ``dog`` for DoG primitives, ``slopes`` and ``curvatures`` for colours that vary
         over their primitive, ``cuts`` for planes that cut some off, ``second_cuts`` for second ones, and ``shifts``
         for places that depend on the view), compressed PLY, SPZ, SOG, glTF, OpenUSD or .splat. The integrator draws it
         as its file says, unless the shape or the integrator is told otherwise.

     * - means, log_scales, quats, logit_opacities, sh_coeffs
       - |tensor|
       - Raw parameters instead of a file: centres [N, 3] and logarithms of standard deviations [N, 3] in world units,
         quaternions [N, 4] (x, y, z, w; of any length but zero), logits of opacities [N], and SH coefficients
         [N, K, 3] with K = (degree + 1)².
       - |exposed|, |differentiable|

     * - dog_index, dog_logit_opacities, dog_log_scales
       - |tensor|
       - The M primitives that are DoG: their rows [M], logit of the opacity factor f_a [M], log of the scale
         factors F [M, 3]. Absent for a model of plain Gaussians.
       - |exposed|, |differentiable| (not the index)

     * - slope_index, color_slopes
       - |tensor|
       - The S primitives whose colour varies linearly over them: their rows [S], and the change of the colour per
         standard deviation along each axis of the primitive [S, 3, 3], axis by channel. Absent for a model of which
         no primitive has slopes.
       - |exposed|, |differentiable| (not the index)

     * - curvature_index, brightness_curvatures
       - |tensor|
       - The B primitives whose brightness curves over them (docs/curvatures.md), with slopes or without: their rows
         [B], and its second derivatives per standard deviation along the axes of the primitive, the same for all
         channels, xx, yy, zz, xy, xz, yz [B, 6]. Absent for a model of which no primitive has curvatures.
       - |exposed|, |differentiable| (not the index)

     * - cut_index, cut_normals
       - |tensor|
       - The C primitives that a plane cuts off (docs/cuts.md): their rows [C], and the normal of the plane towards what
         is kept, along the axes of the primitive and per standard deviation [C, 3]; its length is how steep the cut is.
         Absent for a model of which each primitive is whole.
       - |exposed|, |differentiable| (not the index)

     * - second_cut_index, second_cut_normals
       - |tensor|
       - The C2 primitives that a second plane cuts off, with the first one or without: their rows [C2], and the normals
         [C2, 3], as above. What both leave of a primitive is the product of what each does. Absent for a model in which
         one plane at most cuts off a primitive.
       - |exposed|, |differentiable| (not the index)

     * - shift_index, view_shifts, mean_views
       - |tensor|
       - The V primitives whose place depends on the view (docs/shifts.md): their rows [V], by how many standard
         deviations along each of their axes they move when the direction of the view changes by 1 along each of them
         [V, 3, 3], axis of the move by axis of the direction, and the direction along these axes for which they stand
         at their means [V, 3]. Absent for a model of which each primitive stands still.
       - |exposed|, |differentiable| (not the index)

     * - sh1_index, sh1_coeffs, sh2_index, sh2_coeffs, sh3_index, sh3_coeffs
       - |tensor|
       - Primitives with SH degrees of their own, beside sh_coeffs with K = 1: those of degree 1, 2 and 3, their rows
         [M1], [M2], [M3] and their coefficients without the constant one [M1, 3, 3], [M2, 8, 3], [M3, 15, 3]. Absent
         where all primitives have one degree.
       - |exposed|, |differentiable| (not the indices)

     * - antialiased, near_clip, linear, white
       - |bool|, |float|, |bool|, |float|
       - How the model is drawn, in place of what its file says (docs/export.md): opacities make up for the screen-space
         low-pass filter; primitives nearer to the camera plane are dropped, in units of the model; colours are linear
         radiance; the radiance that a screen shows as white. The integrator's own parameters come first. (Default: as
         the file says)

     * - to_world
       - |transform|
       - Any linear map that does not flatten, and translation; its last row is 0, 0, 0, 1. It turns the spherical
         harmonics too (docs/transforms.md). What is given is applied once at load. The exposed parameter starts as the
         identity and moves the loaded primitives further: by rotation, mirror, uniform scale and translation.
         (Default: identity)
       - |exposed|, |differentiable|

    A DoG primitive is the difference of its Gaussian, of opacity a and scales s, and a wider or narrower
    *pseudo-Gaussian* with the same centre, orientation and colour, also where that varies, of opacity f_a·a and scales
    F·s (arXiv 2602.24136, Sec. 3.3). Each cut takes the same share of both.

    The shape has no surface: rays do not meet it. Render it with the integrator ``dogsplat`` or ``dogpath``. The number
    of primitives may change through ``params.update()``. What does not fit raises a ``RuntimeError`` that names it: a
    file that is no model, tensors whose shapes do not agree, a ``to_world`` that flattens. ``bbox()`` of the shape is
    the box of its centres, and does not count in ``bbox()`` of the scene, for which Mitsuba asks no shape that is
    written in Python.

    .. code-block:: python

        'splats': {
            'type': 'dog',
            'filename': 'model.ply'
        }
    """

    # raw parameters, as the names in ``RAW``; those of ``GROUPS`` where a primitive is in one
    means: mi.TensorXf
    log_scales: mi.TensorXf
    quats: mi.TensorXf
    logit_opacities: mi.TensorXf
    sh_coeffs: mi.TensorXf
    dog_logit_opacities: mi.TensorXf
    dog_log_scales: mi.TensorXf
    color_slopes: mi.TensorXf
    brightness_curvatures: mi.TensorXf
    cut_normals: mi.TensorXf
    second_cut_normals: mi.TensorXf
    view_shifts: mi.TensorXf
    mean_views: mi.TensorXf
    sh1_coeffs: mi.TensorXf
    sh2_coeffs: mi.TensorXf
    sh3_coeffs: mi.TensorXf
    dog_index: mi.UInt32
    slope_index: mi.UInt32
    curvature_index: mi.UInt32
    cut_index: mi.UInt32
    second_cut_index: mi.UInt32
    shift_index: mi.UInt32
    sh1_index: mi.UInt32
    sh2_index: mi.UInt32
    sh3_index: mi.UInt32

    def __init__(self, props: Any):
        _start_as_a_point(self)
        self.set_id(props.id())
        try:
            model, self.source = given_model(props)
        except (TypeError, ValueError, OSError) as error:
            raise RuntimeError(f"dog: {error}") from None
        try:
            matrix = matrix_of(props.get("to_world", mi.ScalarTransform4f()))
            splats = transformed(model.splats, matrix)
        except (TypeError, ValueError) as error:
            raise self._unfit("to_world", error) from None
        self._assign(splats)
        self.drawing = model.drawing.enlarged(mean_scale(matrix))  # what it says is in units of the file
        self.to_world, self._moves = mi.Transform4f(), False
        # whether the last update fits; shapes of the tensors, and widths of the indices, in the last that did
        self._fits, self._checked = True, self._shapes()

    def _assign(self, splats: Splats):
        self.groups = [group for group in GROUPS if len(getattr(splats, group.index))]
        for name in self._tensors():
            setattr(self, name, device_tensor(getattr(splats, name)))
        for group in self.groups:
            setattr(self, group.index, device_array(getattr(splats, group.index), mi.UInt32))
        self._rows = {  # of the groups of which kernels ask for the row of a primitive: index [M] to its inverse [N]
            group.index: rows_of_splats(getattr(splats, group.index), splats.n_splats)
            for group in self.groups
            if group in BESIDE_COLORS
        }

    def traverse(self, callback: mi.TraversalCallback):
        for name in self._tensors():
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)
        for group in self.groups:
            callback.put(group.index, getattr(self, group.index), mi.ParamFlags.NonDifferentiable)
        callback.put("to_world", self.to_world, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys: list[str] = []):  # noqa: B006 (signature of Mitsuba)
        refuse_freezing("dog", "an update of parameters")
        if not self._fits:
            keys = []  # the update before raised, so that nothing is known of what it changed
        self._fits = False
        shapes = self._shapes()
        if "to_world" in keys or not keys:
            self._update_transform(keys)
        self._require_rows(shapes)
        self._update_rows(keys, shapes)
        self._fits, self._checked = True, shapes

    def _update_transform(self, keys: list[str]):
        dr.make_opaque(self.to_world)  # kernels that hold its numbers would be compiled for each frame of a film
        try:
            matrix = self._matrix()
            decompose_similarity(matrix)
        except ValueError as error:
            raise self._unfit("to_world", error) from None
        self._moves = "to_world" in keys or not np.array_equal(matrix, np.eye(4))

    def _unfit(self, name: str, error: Exception) -> RuntimeError:
        """What is wrong with a parameter, with the name of the shape where somebody gave it one."""
        named = self.id() and not self.id().startswith("_")  # as Mitsuba begins those that it makes up
        own = f' of "{self.id()}"' if named else ""
        return RuntimeError(f'dog: "{name}"{own}: {error}')

    def _require_rows(self, shapes: dict[str, tuple]):
        """Tensors of these ``shapes`` have a row for each primitive, or for each that is in their group."""
        n, size = (shapes["means"] or (0,))[0], require_sh_size(shapes["sh_coeffs"])
        rows = {"means": (3,), "log_scales": (3,), "quats": (4,), "logit_opacities": (), "sh_coeffs": (size, 3)}
        require_rows(shapes, rows, n, "means")
        for group in self.groups:
            require_rows(shapes, group.arrays, shapes[group.index][0], group.index)

    def _update_rows(self, keys: list[str], shapes: dict[str, tuple]):
        """The rows of primitives, where an index is another, or the number of primitives is: reading one waits for the
        device."""
        changed = [g for g in self.groups if not keys or g.index in keys or shapes["means"] != self._checked["means"]]
        for group in changed:
            index = getattr(self, group.index).numpy()
            require_index(group.index, index, shapes["means"][0])
            if group in BESIDE_COLORS:
                self._rows[group.index] = rows_of_splats(index, shapes["means"][0])
        of_degrees = [group for group in SH.values() if group in self.groups]
        if of_degrees and (changed or shapes["sh_coeffs"] != self._checked["sh_coeffs"]):
            indices = [getattr(self, group.index).numpy() for group in of_degrees]
            require_one_degree(indices, shapes["sh_coeffs"][1])

    @property
    def parameters(self) -> dict:
        """Flat arrays for ``rasterize``, attached to the AD graph wherever the tensors are.

        Raises ``RuntimeError`` where the last update did not fit, or tensors of other sizes that nobody has updated do
        not: kernels would read beyond the ends of arrays.
        """
        if not self._fits or self._shapes() != self._checked:
            self.parameters_changed()
        params = {name: getattr(self, name).array for name in RAW}
        for group in self._in_use():
            params |= {name: getattr(self, name).array for name in group.names}
            params[group.index] = getattr(self, group.index)
            if group in BESIDE_COLORS:
                params[group.row] = self._rows[group.index]
        for degree, group in SH.items():
            if group.index in params:
                (name,) = group.names
                params[name] = padded_on_device(params[name], degree)
        return moved(params, self.to_world) if self._moves or dr.grad_enabled(self.to_world) else params

    def _tensors(self) -> list[str]:
        """Names of the differentiable parameters of primitives."""
        return [*RAW, *(name for group in self.groups for name in group.names)]

    def _shapes(self) -> dict[str, tuple]:
        """Of the tensors and indices, by their names."""
        widths = {group.index: (dr.width(getattr(self, group.index)),) for group in self.groups}
        return {name: tuple(getattr(self, name).shape) for name in self._tensors()} | widths

    def _matrix(self) -> np.ndarray:
        """The parameter ``to_world`` on the host."""
        return matrix_of(dr.detach(self.to_world))

    def _in_use(self) -> list[RowGroup]:
        """Groups that have a row; one that has been emptied may get rows again."""
        return [group for group in self.groups if dr.width(getattr(self, group.index))]

    @property
    def sh_size(self) -> int:
        """Number of SH coefficients per channel, of the highest degree that a primitive has."""
        in_use = self._in_use()
        return max([self.sh_coeffs.shape[1], *((d + 1) ** 2 for d, group in SH.items() if group in in_use)])

    def to_splats(self) -> Splats:
        """A copy of the current parameters as a model on the host, e.g. for ``write_ply``."""
        names = [*self._tensors(), *(group.index for group in self.groups)]
        # on LLVM an array of NumPy shows the memory of the parameter
        splats = Splats(**{name: np.array(on_host(dr.detach(getattr(self, name)))) for name in names})
        return transformed(splats, self._matrix()) if self._moves else splats

    def bbox(self) -> mi.ScalarBoundingBox3f:
        """Box of the centres, in all their places where these depend on the view."""
        box = mi.ScalarBoundingBox3f()
        matrix = self._matrix()
        means = on_host(dr.detach(self.means)) @ matrix[:3, :3].T + matrix[:3, 3]
        corners = [means.min(0), means.max(0)] if len(means) else []
        if SHIFTS in self._in_use():
            corners += box_of_places(self.to_splats())
        for corner in corners:
            box.expand(mi.ScalarPoint3f(corner))
        return box

    def to_string(self) -> str:
        lines = [f"source = {self.source}", f"primitives = {self.means.shape[0]}"]
        lines.append(f"dog = {len(self.dog_index) if DOG in self.groups else 0}")
        named = NAMED | {group.index: group for group in SH.values()}
        lines += [f"{name} = {len(getattr(self, g.index))}" for name, g in named.items() if g in self.groups]
        return "DogShape[\n  " + ",\n  ".join(lines) + "\n]"


def _start_as_a_point(mesh: Any) -> None:
    """Construct a mesh of one triangle without area.

    Rays never meet it, and Mitsuba's vectorised calls, which also trace the meshes of other scenes, find no empty
    buffer. Mitsuba 3.10 has no constructor with counts; it fills what was constructed empty. The attribute keeps
    Mitsuba's loader from merging two shapes of equal parameters into one plain mesh, without primitives.
    """
    if hasattr(mesh, "from_fields"):
        mi.Mesh.__init__(mesh, mi.Properties())
        corners: Any = mi.TensorXu  # of a stub that has no constructor
        mesh.from_fields(faces=corners(np.zeros((1, 3), np.uint32)), positions=device_tensor(np.zeros((3, 3))))
    else:
        mi.Mesh.__init__(mesh, "dog", vertex_count=3, face_count=1)
    mesh.add_attribute("face_dog", 1, [0.0])


mi.register_shape("dog", lambda props: DogShape(props))

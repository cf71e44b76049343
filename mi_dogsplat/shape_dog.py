"""Shape plugin ``dog``: a cloud of Gaussian and Difference-of-Gaussians primitives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from .engine.motion import moved
from .engine.parameters import RAW, RAW_DOG, device_array, dog_rows
from .formats.model import Model
from .formats.read import read_model
from .scene.splats import Splats
from .scene.transform import decompose_similarity, transformed


class DogShape(mi.Mesh):
    """.. _shape-dog:

    Gaussian and Difference-of-Gaussians primitives (:monosp:`dog`)
    ---------------------------------------------------------------

    .. pluginparameters::

     * - filename
       - |string|
       - Model: PLY (with a second element ``dog`` for DoG primitives), compressed PLY, SPZ, SOG, glTF or .splat. The
         integrator draws it as its file says, unless it is told otherwise.

     * - means, log_scales, quats, logit_opacities, sh_coeffs
       - |tensor|
       - Raw parameters instead of a file: [N, 3], [N, 3], [N, 4] (x, y, z, w), [N], [N, K, 3] with K = (degree + 1)².
       - |exposed|, |differentiable|

     * - dog_index, dog_logit_opacities, dog_log_scales
       - |tensor|
       - The M primitives that are DoG: their rows [M], logit of the opacity factor f_a [M], log of the scale
         factors F [M, 3]. Absent for a model of plain Gaussians.
       - |exposed|, |differentiable| (not the index)

     * - to_world
       - |transform|
       - Rotation, uniform scale and translation; turns the spherical harmonics too. What is given is applied once at
         load. The exposed parameter starts as the identity and moves the loaded primitives further. (Default: identity)
       - |exposed|, |differentiable|

    A DoG primitive is the difference of its Gaussian and a wider or narrower *pseudo-Gaussian* with the same centre,
    orientation and colour, opacity f_a·a and scales F·s (method paper, Sec. 3.3).

    The shape has no surface: rays do not meet it. Render it with the ``dogsplat`` integrator. The number of primitives
    may change through ``params.update()``.

    .. code-block:: python

        'splats': {
            'type': 'dog',
            'filename': 'model.ply'
        }
    """

    # raw parameters, as the names in ``RAW`` and ``RAW_DOG``
    means: mi.TensorXf
    log_scales: mi.TensorXf
    quats: mi.TensorXf
    logit_opacities: mi.TensorXf
    sh_coeffs: mi.TensorXf
    dog_logit_opacities: mi.TensorXf
    dog_log_scales: mi.TensorXf

    def __init__(self, props: Any):
        _start_as_a_point(self)
        self.set_id(props.id())
        given = [name for name in (*RAW, "dog_index", *RAW_DOG) if name in props]
        if ("filename" in props) == bool(given):
            raise RuntimeError(
                'dog: specify either "filename" or the tensors "means", "log_scales", "quats", "logit_opacities" and '
                f'"sh_coeffs"; found {"both" if given else "neither"}'
            )
        try:
            if given:
                model = Model(Splats(**{name: _to_numpy(props[name]) for name in given}))
                self.source = "tensors"
            else:
                resolver = cast(Any, mi.file_resolver)()
                self.source = str(resolver.resolve(props["filename"]))
                model = read_model(self.source)
            matrix = np.array(props.get("to_world", mi.ScalarTransform4f()).matrix, dtype=np.float64)
            splats = transformed(model.splats, matrix)
        except TypeError:
            missing = [name for name in RAW if name not in given]
            raise RuntimeError(f'dog: missing tensors {", ".join(missing)}') from None
        except (ValueError, OSError) as error:
            raise RuntimeError(f"dog: {error}") from None
        self._assign(splats)
        self.drawing = model.drawing
        if self.drawing.near_clip is not None:  # in units of the file
            self.drawing = replace(self.drawing, near_clip=self.drawing.near_clip * decompose_similarity(matrix)[1])
        self.to_world, self._moves = mi.Transform4f(), False

    def _assign(self, splats: Splats):
        for name in RAW:
            setattr(self, name, _tensor(getattr(splats, name)))
        self.has_dog = splats.n_dog > 0
        if self.has_dog:
            for name in RAW_DOG:
                setattr(self, name, _tensor(getattr(splats, name)))
            self.dog_index = device_array(splats.dog_index, mi.UInt32)
            self._dog_row = dog_rows(splats.dog_index, splats.n_splats)

    def traverse(self, callback: mi.TraversalCallback):
        for name in RAW + (RAW_DOG if self.has_dog else ()):
            callback.put(name, getattr(self, name), mi.ParamFlags.Differentiable)
        if self.has_dog:
            callback.put("dog_index", self.dog_index, mi.ParamFlags.NonDifferentiable)
        callback.put("to_world", self.to_world, mi.ParamFlags.Differentiable)

    def parameters_changed(self, keys: list[str] = []):  # noqa: B006 (signature of Mitsuba)
        n = self.means.shape[0]
        k = self.sh_coeffs.shape[1] if len(self.sh_coeffs.shape) == 3 else 0
        if k not in (1, 4, 9, 16):
            raise RuntimeError(f'dog: "sh_coeffs" has shape {tuple(self.sh_coeffs.shape)}, expected (N, 1/4/9/16, 3)')
        if "to_world" in keys:
            try:
                decompose_similarity(self._matrix())
            except ValueError as error:
                raise RuntimeError(f'dog: "to_world": {error}') from None
            self._moves = True
        rows = {"means": (3,), "log_scales": (3,), "quats": (4,), "logit_opacities": (), "sh_coeffs": (k, 3)}
        self._check_rows(rows, n, "means")
        if not self.has_dog:
            return
        self._check_rows({"dog_logit_opacities": (), "dog_log_scales": (3,)}, dr.width(self.dog_index), "dog_index")
        if not keys or "dog_index" in keys or "means" in keys:
            index = self.dog_index.numpy()
            if index.size and int(index.max()) >= n:
                raise RuntimeError(f'dog: "dog_index" names primitive {int(index.max())}, "means" has {n} rows')
            if np.any(index[1:] <= index[:-1]):
                raise RuntimeError('dog: "dog_index" is not strictly increasing; sort it, each primitive once')
            self._dog_row = dog_rows(index, n)

    def _check_rows(self, rows: dict, n: int, like: str):
        """Raise unless every tensor in ``rows`` (name to the shape of a row) has ``n`` rows, as ``like`` has."""
        for name, tail in rows.items():
            shape = tuple(getattr(self, name).shape)
            if shape != (n, *tail):
                raise RuntimeError(f'dog: "{name}" has shape {shape}, expected {(n, *tail)} to match "{like}"')

    @property
    def parameters(self) -> dict:
        """Flat arrays for ``rasterize``, attached to the AD graph wherever the tensors are."""
        params = {name: getattr(self, name).array for name in RAW}
        if self.has_dog and dr.width(self.dog_index):
            params |= {name: getattr(self, name).array for name in RAW_DOG}
            params["dog_index"], params["dog_row"] = self.dog_index, self._dog_row
        return moved(params, self.to_world) if self._moves else params

    def _matrix(self) -> np.ndarray:
        """The parameter ``to_world`` on the host."""
        return np.array(dr.detach(self.to_world.matrix), dtype=np.float64).reshape(4, 4)

    @property
    def sh_size(self) -> int:
        """Number of SH coefficients per channel."""
        return self.sh_coeffs.shape[1]

    def to_splats(self) -> Splats:
        """The current parameters as a model on the host, e.g. for ``write_ply``."""
        names = RAW + RAW_DOG if self.has_dog else RAW
        arrays = {name: _to_numpy(dr.detach(getattr(self, name))) for name in names}
        if self.has_dog:
            arrays["dog_index"] = self.dog_index.numpy()
        splats = Splats(**arrays)
        return transformed(splats, self._matrix()) if self._moves else splats

    def bbox(self) -> mi.ScalarBoundingBox3f:
        """Box of the centres."""
        box = mi.ScalarBoundingBox3f()
        matrix = self._matrix()
        means = _to_numpy(dr.detach(self.means)) @ matrix[:3, :3].T + matrix[:3, 3]
        if len(means):
            box.expand(mi.ScalarPoint3f(means.min(0)))
            box.expand(mi.ScalarPoint3f(means.max(0)))
        return box

    def to_string(self) -> str:
        m = self.dog_index if self.has_dog else []
        return f"DogShape[\n  source = {self.source},\n  primitives = {self.means.shape[0]},\n  dog = {len(m)}\n]"


def _start_as_a_point(mesh: Any) -> None:
    """Construct a mesh of one triangle without area.

    Rays never meet it, and Mitsuba's vectorised calls, which also trace the meshes of other scenes, find no empty
    buffer. Mitsuba 3.10 has no constructor with counts; it fills what was constructed empty.
    """
    if hasattr(mesh, "from_fields"):
        mi.Mesh.__init__(mesh, mi.Properties())
        corners: Any = mi.TensorXu  # of a stub that has no constructor
        mesh.from_fields(faces=corners(np.zeros((1, 3), np.uint32)), positions=_tensor(np.zeros((3, 3))))
    else:
        mi.Mesh.__init__(mesh, "dog", vertex_count=3, face_count=1)


def _tensor(values: np.ndarray) -> mi.TensorXf:
    return mi.TensorXf(device_array(values), values.shape)


def _to_numpy(tensor) -> np.ndarray:
    return tensor.numpy() if dr.is_array_v(tensor) else np.asarray(tensor)


mi.register_shape("dog", lambda props: DogShape(props))

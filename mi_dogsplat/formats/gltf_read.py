"""Reading glTF with Gaussians: all primitives of the scene that have the extension, moved by their nodes.

Compressed ones, by KHR_gaussian_splatting_compression_spz_2, hold an SPZ file in a buffer view.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.drawing import Drawing, drawing_of_extras
from ..scene.scales import SMALLEST_SCALE
from ..scene.splats import Array, Splats
from ..support.errors import DAMAGED, DataError
from ..support.wording import printable
from .gltf_container import Container, entry, matrix_of
from .limits import in_proportion
from .model import Model
from .packing import LUF, RUB, logits, turned
from .placed import in_one_place, require_alike
from .spz import content_of

NAME = "KHR_gaussian_splatting"
SPZ = ("KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz")
KNOWN = (NAME, *SPZ, "KHR_mesh_quantization")
MOST_NAMES = 3  # of extensions in a line
WITHOUT = "export it without that"
LINEAR, DISPLAY = "lin_rec709_display", "srgb_rec709_display"
MAX_DEPTH = 64  # of nodes in nodes


def read(path: Path) -> Model:
    """The Gaussians of a file, in LUF axes. Raises ``DataError``."""
    container = Container.open(path)
    try:
        found = list(in_proportion(_models(container), path.stat().st_size))
        if not found and "asset" not in container.content:  # any JSON is taken for glTF, which has to have that
            raise DataError(path, "is neither a glTF nor the meta.json of a SOG", "give the file of a model")
        if not found:
            raise DataError(path, f"holds no primitive with {NAME}", "export it as Gaussians")
        require_alike(path, found)
        return in_one_place(found, LUF)
    except DataError:
        raise
    except (struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError) as error:
        problem = f"is not a glTF file of Gaussians ({type(error).__name__}: {error})"
        if needed := _not_known(container.content):
            raise DataError(path, f"needs {needed}, which is not read, and without it {problem}", WITHOUT) from error
        raise DataError(path, problem, DAMAGED) from error


def _not_known(content: Any) -> str:
    """Names of the extensions without which a file says that it cannot be read, of those that are not read here."""
    required = content.get("extensionsRequired") if isinstance(content, dict) else None
    names = [str(name) for name in required if name not in KNOWN] if isinstance(required, list) else []
    return ", ".join(names[:MOST_NAMES])


def _models(container: Container) -> Iterator[tuple[Model, Array]]:
    """The model of each primitive, and the matrix [4, 4] of its node."""
    content = container.content
    for node, matrix in _nodes(content):
        for primitive in entry(content["meshes"], node["mesh"])["primitives"]:
            extension = (primitive.get("extensions") or {}).get(NAME)
            if extension is None:
                continue
            yield _of_primitive(container, primitive, extension), matrix


def _nodes(content: Any) -> Iterator[tuple[Any, Array]]:
    """Nodes with a mesh and their matrices [4, 4] in the world; without a scene, all nodes that no other has."""
    nodes = content.get("nodes", [])
    scenes = content.get("scenes")
    children = {child for node in nodes for child in node.get("children", [])}
    roots = entry(scenes, content.get("scene", 0)).get("nodes", ()) if scenes else set(range(len(nodes))) - children
    waiting = [(root, np.eye(4), 0) for root in roots]
    visits = 0
    while waiting:
        index, above, depth = waiting.pop(0)
        visits += 1
        if depth > MAX_DEPTH or visits > len(nodes):
            raise ValueError("its nodes do not form trees")
        node = entry(nodes, index)
        matrix = above @ matrix_of(node)
        if "mesh" in node:
            yield node, matrix
        waiting += [(child, matrix, depth + 1) for child in node.get("children", [])]


def _of_primitive(container: Container, primitive: Any, extension: Any) -> Model:
    drawing, left_out = _drawing(primitive, extension), _left_out(extension)
    inner = extension.get("extensions") or {}
    compressed = next((inner[name] for name in SPZ if name in inner), None)
    if compressed is not None:
        model = content_of(container.path, container.view(compressed["bufferView"]))
        splats = turned(turned(model.splats, RUB), LUF)
        return Model(splats, drawing.over(model.drawing), (*left_out, *model.left_out))
    given = primitive["attributes"]
    bands = _sh_names(given)
    names = ["POSITION", *(f"{NAME}:{name}" for name in ("SCALE", "ROTATION", "OPACITY")), *bands]
    values = {name: container.accessor(given[name]) for name in names}
    if "indices" in primitive:  # those are drawn, in this order
        rows = container.accessor(primitive["indices"])[:, 0].astype(np.int64)
        values = {name: column[rows] for name, column in values.items()}
    scales = values[f"{NAME}:SCALE"].astype(np.float64)
    if scales.min(initial=1) < 0:
        raise ValueError("a scale is negative")
    splats = Splats(
        means=values["POSITION"],
        log_scales=np.log(np.maximum(scales, SMALLEST_SCALE)),
        quats=values[f"{NAME}:ROTATION"],
        logit_opacities=logits(values[f"{NAME}:OPACITY"][:, 0]),
        sh_coeffs=np.stack([values[name] for name in bands], axis=1),
    )
    return Model(splats, drawing, left_out)


def _left_out(extension: Any) -> tuple[str, ...]:
    """A line for a kernel and for a colour space that are not known here: the usual ones are taken."""
    kernel, space = extension.get("kernel", "ellipse"), extension.get("colorSpace", DISPLAY)
    lines = [] if kernel == "ellipse" else [f"its kernel {printable(str(kernel))[:60]}"]
    lines += [] if space in (LINEAR, DISPLAY) else [f"its colour space {printable(str(space))[:60]}"]
    return tuple(lines)


def _sh_names(attributes: Mapping[str, Any]) -> list[str]:
    """Attributes of the coefficients, of the degrees that are there whole."""
    names: list[str] = []
    for degree in range(4):
        band = [f"{NAME}:SH_DEGREE_{degree}_COEF_{n}" for n in range(2 * degree + 1)]
        if degree and not all(name in attributes for name in band):
            break
        names += band
    return names


def _drawing(primitive: Any, extension: Any) -> Drawing:
    """What is said on the drawing: by ``colorSpace``, and before it by our ``extras``."""
    linear = {LINEAR: True, DISPLAY: False}.get(str(extension.get("colorSpace")))
    return drawing_of_extras(primitive.get("extras")).over(Drawing(linear=linear))

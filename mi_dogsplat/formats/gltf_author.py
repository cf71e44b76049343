"""Written glTF: arrays as accessors of one buffer, and a scene of one primitive."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..scene.splats import Array
from ..support.errors import DataError
from .gltf_container import TooLarge, glb, gltf

COMPONENTS = {"float32": 5126, "uint8": 5121, "uint32": 5125}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ATTRIBUTES, INDICES = 34962, 34963  # what a view of the buffer is for
BYTES = np.dtype(np.uint8)  # colours, whose 255 is 1


class Accessors:
    """Arrays and pictures of a file, one behind the other in its buffer, each from a multiple of 4 bytes on."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []
        self._parts: list[bytes] = []
        self._at = 0

    def add(self, values: Array, target: int = ATTRIBUTES, bounds: bool = False) -> int:
        """The number of the accessor of values [N, components], float32, uint8 or uint32; ``bounds``: with their
        least and largest, as glTF asks for of positions."""
        accessor: dict[str, Any] = {"bufferView": self.view(values.tobytes(), target=target)}
        accessor |= {"componentType": COMPONENTS[values.dtype.name]}
        accessor |= {"count": len(values), "type": KINDS[values.shape[1]]}
        if values.dtype == BYTES:
            accessor["normalized"] = True
        if bounds:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def view(self, raw: bytes, **more: Any) -> int:
        """The number of the view of the buffer that holds these bytes, such as those of a picture."""
        self._views.append({"buffer": 0, "byteOffset": self._at, "byteLength": len(raw), **more})
        self._parts.append(raw + bytes(-len(raw) % 4))
        self._at += len(self._parts[-1])
        return len(self._views) - 1

    def file(self, primitive: dict[str, Any], matrix: Array, used: list[str], binary: bool, **more: Any) -> bytes:
        """The bytes of a file with one primitive.

        Args:
            primitive: as glTF has it.
            matrix: [4, 4] of its node.
            used: names of extensions.
            binary: .glb, else .gltf.
            more: what else stands in the JSON, such as ``materials``.

        Raises ``TooLarge`` for a .glb of more bytes than there may be.
        """
        node: dict[str, Any] = {"mesh": 0}
        if not np.array_equal(matrix, np.eye(4)):
            node["matrix"] = matrix.T.ravel().tolist()
        content = {
            "asset": {"version": "2.0", "generator": "mi_dogsplat"},
            "extensionsUsed": used,
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
            "meshes": [{"primitives": [primitive]}],
            **more,
            "accessors": self.accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._at}],
        }
        return (glb if binary else gltf)(content, b"".join(self._parts))


@contextmanager
def made_for(path: Path) -> Iterator[None]:
    """While the bytes of a file are made: raises ``DataError`` where a .glb would be too large."""
    try:
        yield
    except TooLarge as error:
        raise DataError(path, str(error), "name a .gltf, or another format, or write fewer") from error

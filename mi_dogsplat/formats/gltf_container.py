"""The container of glTF 2.0: a JSON and its buffers, in one file (.glb), beside it or within it (.gltf)."""

from __future__ import annotations

import base64
import json
import struct
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..scene.cameras import affine
from ..scene.quaternions import rotation_from_quaternion
from ..scene.splats import Array
from ..support.errors import DAMAGED, DataError
from ..support.files import parse_json

MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
LARGEST = 2**32 - 1  # bytes of a .glb
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


@dataclass
class Container:
    """An open file; ``content`` is its JSON. Methods raise ``ValueError``, ``KeyError`` for what is wrong."""

    path: Path
    content: Any
    binary: bytes = b""
    buffers: dict[int, bytes] = field(default_factory=dict)

    @classmethod
    def open(cls, path: Path) -> Container:
        """A file of either kind. Raises ``DataError``."""
        data = path.read_bytes()
        try:
            if data[:4] != MAGIC.to_bytes(4, "little"):
                return cls(path, parse_json(data.decode("utf-8-sig")))  # editors of Windows begin a file with a mark
            _, version, whole, length, kind = struct.unpack_from("<IIIII", data)
            if version != VERSION or kind != JSON_CHUNK:
                raise ValueError(f"version {version}")
            if whole > len(data):
                raise ValueError(f"{whole} bytes are promised, there are {len(data)}")
            content, binary = parse_json(data[20 : 20 + length].decode()), b""
            if len(data) >= 28 + length:
                size, kind = struct.unpack_from("<II", data, 20 + length)
                binary = data[28 + length : 28 + length + size] if kind == BINARY_CHUNK else b""
            return cls(path, content, binary)
        except (struct.error, ValueError) as error:
            raise DataError(path, f"is not glTF 2 ({error})", DAMAGED) from error

    def accessor(self, index: Any) -> Array:
        """Values [count, width] of an accessor, as numbers; normalised integers become 0..1 or -1..1.

        Raises ``DataError`` for a sparse one, which glTF allows and nobody writes of Gaussians.
        """
        accessor = entry(self.content["accessors"], index)
        if "sparse" in accessor:
            raise DataError(self.path, f"its accessor {index} is sparse, which is not read", "export it without that")
        width, count = WIDTHS[accessor["type"]], _whole(accessor["count"])
        dtype = np.dtype(TYPES[accessor["componentType"]])
        view = entry(self.content["bufferViews"], accessor["bufferView"])
        data = self.view(accessor["bufferView"])[_whole(accessor.get("byteOffset", 0)) :]
        row = width * dtype.itemsize
        stride = _whole(view.get("byteStride", row)) or row
        if stride < row or (count and (count - 1) * stride + row > len(data)):
            raise ValueError(f"an accessor of {count} rows does not fit its {len(data)} bytes")
        if not count:
            return np.zeros((0, width))
        values = np.lib.stride_tricks.as_strided(
            np.frombuffer(data, np.uint8), (count, row), (stride, 1), writeable=False
        )
        numbers = np.ascontiguousarray(values).view(dtype)
        if dtype.kind == "f":
            return numbers
        scale = np.iinfo(dtype).max if accessor.get("normalized") else 1
        return np.maximum(numbers / scale, -1) if accessor.get("normalized") else numbers.astype(np.float64)

    def view(self, index: Any) -> bytes:
        """Bytes of a buffer view."""
        view = entry(self.content["bufferViews"], index)
        at, size = _whole(view.get("byteOffset", 0)), _whole(view["byteLength"])
        data = self._buffer(view["buffer"])
        if at + size > len(data):
            raise ValueError(f"a buffer view ends at {at + size}, its buffer at {len(data)}")
        return data[at : at + size]

    def _buffer(self, index: Any) -> bytes:
        if index not in self.buffers:
            uri = entry(self.content["buffers"], index).get("uri")
            if uri is None and index:  # the bytes of a .glb are its first buffer alone
                raise ValueError(f"buffer {index} has no bytes that are not compressed")
            self.buffers[index] = self.binary if uri is None else self._fetched(uri)
        return self.buffers[index]

    def files_beside(self) -> list[Path]:
        """Those that its buffers are in. Of a buffer that nobody has read any name may be wrong: such are left out."""
        uris = [buffer.get("uri") for buffer in self.content.get("buffers", ()) if isinstance(buffer, dict)]
        found = set()
        for uri in uris:
            if isinstance(uri, str) and not uri.startswith("data:"):
                with suppress(ValueError):
                    found.add(self._beside(uri))
        return sorted(found)

    def _beside(self, uri: str) -> Path:
        name = unquote(uri)
        if "\0" in name or ":" in name or Path(name).is_absolute() or ".." in Path(name).parts:
            raise ValueError(f'its buffer "{uri[:60]}" is not a file beside it')
        return self.path.parent / name

    def _fetched(self, uri: Any) -> bytes:
        if not isinstance(uri, str):
            raise ValueError('the "uri" of a buffer is not text')
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        file = self._beside(uri)
        try:
            return file.read_bytes()
        except OSError as error:
            problem = f'its buffer "{uri[:60]}" cannot be read ({error.strerror})'
            raise DataError(self.path, problem, "copy it along") from error


def matrix_of(node: Any) -> Array:
    """[4, 4] of a node, from its matrix or from translation, rotation and scale. Raises ``ValueError``."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    quaternion = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64).reshape(1, 4)
    if not quaternion.any():
        raise ValueError("the rotation of a node is zero")
    turn = rotation_from_quaternion(quaternion)[0]
    scale = np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
    return affine(turn * scale, np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3))


class TooLarge(ValueError):
    """More bytes than the header of a .glb can say."""


def glb(content: Any, binary: bytes) -> bytes:
    """A .glb of a JSON and its one buffer. Raises ``TooLarge``."""
    text = json.dumps(content, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    padding = b"\0" * (-len(binary) % 4)
    size = 28 + len(text) + len(binary) + len(padding)
    if size > LARGEST:
        raise TooLarge(f"would have {size / 1e9:.1f} GB, and a .glb has at most {LARGEST / 1e9:.1f}")
    head = struct.pack("<IIIII", MAGIC, VERSION, size, len(text), JSON_CHUNK)
    return b"".join((head, text, struct.pack("<II", size - 28 - len(text), BINARY_CHUNK), binary, padding))


def gltf(content: Any, binary: bytes) -> bytes:
    """A .gltf that holds its one buffer."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    return json.dumps(content | {"buffers": [content["buffers"][0] | {"uri": uri}]}, separators=(",", ":")).encode()


def entry(entries: Any, index: Any) -> Any:
    """An entry of a list; Python's negative indices are none."""
    found = entries[_whole(index)]
    if not isinstance(found, dict):
        raise ValueError("an object is expected where there is none")
    return found


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"{str(value)[:20]} is not a whole number")
    return value

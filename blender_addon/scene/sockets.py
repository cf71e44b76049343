"""What flows into a socket of a node: a number, a colour, or an image by texture coordinates."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Euler

from ..files.errors import told
from .export import Export, Plugin, blender_rgb, rgb
from .images import bitmap

OWN_VALUE = 'the node "{node}" has no counterpart in Mitsuba; its socket keeps its own value'
ROUNDING = 1e-4  # of white in another working space
WRAPPING = {"REPEAT": "repeat", "EXTEND": "clamp", "MIRROR": "mirror"}


@dataclass
class Reader:
    """Reads the sockets of one material, whose name is in what it has to say."""

    export: Export
    owner: str
    uv_maps: frozenset[str] = frozenset()  # those that are rendered, of the meshes that have it

    def note(self, text: str, **values: Any) -> None:
        """Say once what is drawn differently; a template where there are values."""
        self.export.note('"{name}": {reason}', name=self.owner, reason=told(text, **values))

    def color(self, socket: bpy.types.NodeSocket, factor: float = 1.0) -> Plugin:
        """A colour or a texture, multiplied."""
        source = self.source(socket)
        if source is None:
            return blender_rgb(np.multiply(socket.default_value[:3], factor))
        constant = _constant(source.node)
        if constant is not None:
            return blender_rgb(np.multiply(constant if isinstance(constant, tuple) else (constant,) * 3, factor))
        texture = self.texture(source, factor)
        if texture is None:
            return blender_rgb(np.multiply(socket.default_value[:3], factor))
        return texture

    def reflectance(self, socket: bpy.types.NodeSocket, factor: float = 1.0) -> Plugin:
        """The same of what a surface reflects or lets through, of which Mitsuba takes no colour above 1."""
        color = self.color(socket, factor)
        if color["type"] != "rgb":
            return color
        if max(color["value"]) > 1 + ROUNDING:
            self.note("colors above 1 are drawn as 1")
        return rgb(np.minimum(color["value"], 1))

    def share(self, socket: bpy.types.NodeSocket) -> float | Plugin:
        """A number, brought to 0..1 as Cycles does, or a texture."""
        value = self.number(socket)
        return min(max(value, 0.0), 1.0) if isinstance(value, float) else value

    def number(self, socket: bpy.types.NodeSocket) -> float | Plugin:
        """A number or a texture."""
        source = self.source(socket)
        if source is None:
            return float(socket.default_value)
        constant = _constant(source.node)
        if constant is not None:
            return float(np.mean(constant))
        texture = self.texture(source)
        return float(socket.default_value) if texture is None else texture

    def constant(self, socket: bpy.types.NodeSocket, least: float = -math.inf, most: float = math.inf) -> float:
        """A number, where Mitsuba takes no texture, brought between two others as Cycles does."""
        value = self.number(socket)
        if not isinstance(value, float):
            self.note('the texture of "{socket}" is left out', socket=socket.name)
            value = float(socket.default_value)
        return min(max(value, least), most)

    def source(self, socket: bpy.types.NodeSocket) -> Any:
        """As ``source_of``."""
        return source_of(socket)

    def texture(self, source: Any, factor: float = 1.0) -> Plugin | None:
        """An image by the texture coordinates of the mesh; None, with a note, for what is none."""
        node = source.node
        if node.type != "TEX_IMAGE" or node.image is None:
            self.note(OWN_VALUE, node=node.name)
            return None
        texture = bitmap(self.export, node.image, source.name, factor, node.outputs["Alpha"].is_linked)
        if texture is None:
            return None
        if node.extension not in WRAPPING:
            self.note('the image of "{node}" is repeated at its edges, not cut off', node=node.name)
        if node.projection != "FLAT":
            self.note('the image of "{node}" is not projected, but laid by texture coordinates', node=node.name)
        texture["wrap_mode"] = WRAPPING.get(node.extension, "repeat")
        texture["filter_type"] = "nearest" if node.interpolation == "Closest" else "bilinear"
        placing = self._placing(node)
        return texture | ({"to_uv": {"matrix": placing.tolist()}} if placing is not None else {})

    def _placing(self, node: bpy.types.Node) -> np.ndarray | None:
        """[3, 3] of texture coordinates, where a node Mapping changes them."""
        source = self.source(node.inputs["Vector"])
        found = None
        if source is not None and source.node.type == "MAPPING" and source.node.vector_type == "POINT":
            mapping = source.node
            location, rotation, scale = (self.vector(mapping.inputs[k]) for k in ("Location", "Rotation", "Scale"))
            found = np.eye(3)  # what leaves the plane of the picture, when it is turned about x or y, is not looked at
            found[:2, :2] = np.array(Euler(rotation).to_matrix(), np.float64)[:2, :2] * scale[:2]
            found[:2, 2] = location[:2]
            source = self.source(mapping.inputs["Vector"])
        if source is not None and not self._is_rendered(source):
            problem = '"{image}" takes the texture coordinates of the mesh, instead of "{node}"'
            self.note(problem, image=node.name, node=source.node.name)
        return found

    def _is_rendered(self, source: Any) -> bool:
        """Whether it gives the UV map that is rendered, of each mesh."""
        if source.node.type != "UVMAP":
            return source.name == "UV"
        return not source.node.uv_map or self.uv_maps <= {source.node.uv_map}

    def vector(self, socket: bpy.types.NodeSocket) -> np.ndarray:
        """[3] of a mapping, as its own fields have it."""
        if self.source(socket) is not None:
            self.note('what "{socket}" of a mapping is linked to is left out', socket=socket.name)
        return np.array(socket.default_value[:], np.float64)


def constant_of(socket: bpy.types.NodeSocket) -> Any:
    """The number or colour [3] that flows into a socket; None where nodes calculate it."""
    source = source_of(socket)
    if source is not None:
        return _constant(source.node)
    return socket.default_value if socket.type == "VALUE" else socket.default_value[:3]


def _constant(node: bpy.types.Node) -> float | tuple[float, ...] | None:
    if node.type == "RGB":
        return tuple(node.outputs[0].default_value[:3])
    return float(node.outputs[0].default_value) if node.type == "VALUE" else None


def active_tree(owner: Any) -> bpy.types.NodeTree | None:
    """The nodes of a material, world or light, where they are in use; in newer Blenders they always are."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of what is always true there
        return owner.node_tree if owner.node_tree and getattr(owner, "use_nodes", True) else None


def source_of(socket: bpy.types.NodeSocket) -> Any:
    """The socket that a link begins at, past reroutes and muted nodes; None where there is no link."""
    while socket.is_linked and not socket.links[0].is_muted:
        start = socket.links[0].from_socket
        if start.node.type == "REROUTE":
            socket = start.node.inputs[0]
        elif not start.node.mute:
            return start
        else:  # Blender draws a link through it, or none
            through = (link.from_socket for link in start.node.internal_links if link.to_socket == start)
            if (inner := next(through, None)) is None:
                return None
            socket = inner
    return None


def output_of(tree: bpy.types.NodeTree) -> bpy.types.Node | None:
    """Its active output, for all engines or for Cycles, else one for EEVEE."""
    return tree.get_output_node("CYCLES") or tree.get_output_node("EEVEE")

"""The node group of the colours: spherical harmonics in a direction, and between sRGB values and linear light."""

from __future__ import annotations

import bpy
import numpy as np

from ..files.sh import C0, SH_TERMS
from ..files.srgb import KNEE, LINEAR_KNEE, OFFSET, POWER, SCALE, SLOPE
from ..objects.attributes import BASE, CURVATURE_SQUARES, SH
from ..objects.attributes import SCALE as SPLAT_SCALE
from ..objects.working_space import working_matrix
from .builder import Tree, Value, Vector, new_group
from .geometry import switch
from .groups import GEOMETRY, RADIANCE, cached_group, finish_group, named_attribute

LEAST_SCALE = 1e-20  # below, its power -1.5 is no float32 any more


def color_group(space: str = "") -> bpy.types.NodeTree:
    """Colour of a splat seen in a direction: max(0, SH + 0.5), as sRGB values or made linear.

    Linear ones, and the radiance of linear models, are those of the working space. Where the brightness curves over a
    splat, its average is part of the colour.
    """
    name = "DoG Splat color"
    if existing := cached_group(name, space):
        return existing
    sockets = {"Direction": "NodeSocketVector", "SH Degree": "NodeSocketInt", "Linear": "NodeSocketBool"}
    tree, (direction, degree, linear), exit_node = new_group(name, GEOMETRY, sockets, {"Color": "NodeSocketVector"})
    unit = direction.normalized()
    base = Vector(tree, named_attribute(tree, BASE, "FLOAT_COLOR"))
    color = base * C0 + (0.5, 0.5, 0.5)
    color = color + _average_brightness(tree)  # 0 where no splat has curvatures
    for band in range(1, 4):
        (of_band,) = tree.call(_band_group(band), unit)
        color = color + of_band * (degree > band - 0.5)
    color = color.maximum((0.0, 0.0, 0.0))
    (decoded,) = tree.call(_linear_group(), color)
    if space:
        decoded = multiplied(tree, decoded, working_matrix())
    if space.endswith(RADIANCE):
        color = multiplied(tree, color, working_matrix())
    tree.give(exit_node, [switch(tree, "VECTOR", linear, color, decoded)])
    return finish_group(tree, name, space)


def _band_group(band: int) -> bpy.types.NodeTree:
    """What a band of spherical harmonics adds to the colour in a direction, a unit vector."""
    name = f"DoG Splat band {band}"
    if existing := cached_group(name):
        return existing
    tree, (direction,), exit_node = new_group(
        name, GEOMETRY, {"Direction": "NodeSocketVector"}, {"Color": "NodeSocketVector"}
    )
    axes = direction.split()
    powers: dict[tuple[int, int], Value] = {(axis, 1): axes[axis] for axis in range(3)}

    def power(axis: int, exponent: int) -> Value:
        if (axis, exponent) not in powers:
            powers[axis, exponent] = power(axis, exponent - 1) * axes[axis]
        return powers[axis, exponent]

    total = None
    for k in range(band**2, (band + 1) ** 2):
        basis = None
        for coefficient, *exponents in SH_TERMS[k]:
            term = None
            for axis, exponent in enumerate(exponents):
                if exponent:
                    factor = power(axis, exponent)
                    term = factor if term is None else term * factor
            assert term is not None
            basis = term * coefficient if basis is None else tree.math("MULTIPLY_ADD", term, coefficient, basis)
        assert basis is not None
        part = named_attribute(tree, SH.format(k - 1)) * basis
        total = part if total is None else total + part
    tree.give(exit_node, [total])
    return finish_group(tree, name)


def _linear_group() -> bpy.types.NodeTree:
    """Linear light of sRGB values."""
    name = "DoG Splat linear light"
    if existing := cached_group(name):
        return existing
    sockets = {"Color": "NodeSocketVector"}
    tree, (color,), exit_node = new_group(name, GEOMETRY, sockets, sockets)
    channels = []
    for c in color.split():
        toe = c < KNEE
        curve = tree.math("POWER", (c + OFFSET) / SCALE, POWER)
        channels.append(c * toe / SLOPE + curve * (1.0 - toe))
    tree.give(exit_node, [tree.combine(*channels)])
    return finish_group(tree, name)


def linear_to_srgb(tree: Tree, color: Vector) -> Vector:
    """A colour that people picked, as the values that are blended."""
    channels = []
    for c in color.split():
        toe = c < LINEAR_KNEE
        curve = tree.math("POWER", tree.math("MAXIMUM", c, LINEAR_KNEE), 1 / POWER) * SCALE - OFFSET
        channels.append(c * toe * SLOPE + curve * (1.0 - toe))
    return tree.combine(*channels)


def multiplied(tree: Tree, color: Vector, matrix: np.ndarray) -> Vector:
    """A matrix [3, 3] times a colour."""
    return tree.combine(*(color.dot(tuple(row)) for row in matrix.tolist()))


def _average_brightness(tree: Tree) -> Value:
    """By how much curvatures make a splat brighter, on average over views from all sides.

    As ``mi_dogsplat/scene/curvatures.py`` has it: a quarter of what they add along each axis, as far as that lies
    across a view (``mi_dogsplat/scene/across.py``).
    """
    squares = named_attribute(tree, CURVATURE_SQUARES).split()
    scales = [tree.math("MAXIMUM", scale, LEAST_SCALE) for scale in named_attribute(tree, SPLAT_SCALE).split()]
    inverses = [tree.math("POWER", scale, -1.5) for scale in scales]
    total = inverses[0] + inverses[1] + inverses[2]
    x, y, z = [square * (1 - inverse / total) for square, inverse in zip(squares, inverses, strict=True)]
    return (x + y + z) * 0.25

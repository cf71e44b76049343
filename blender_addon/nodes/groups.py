"""Node groups of one formula each: colour from spherical harmonics, kernel on the image plane."""

from __future__ import annotations

import bpy
import numpy as np

from ..files.sh import C0, SH_TERMS
from ..files.srgb import KNEE, LINEAR_KNEE, OFFSET, POWER, SCALE, SLOPE
from ..objects.attributes import BASE, CURVATURE_SQUARES, SH
from ..objects.attributes import SCALE as SPLAT_SCALE
from ..objects.working_space import working_matrix
from .builder import Tree, Value, Vector, arrange, new_group, wrap
from .geometry import switch
from .material import VERSION

LOW_PASS = 0.3  # px², so that no splat falls between the pixels, as in 3DGS
LEAST_SCALE = 1e-20  # below, its power -1.5 is no float32 any more
NEAREST_LEVEL = 255.0  # opacities below 1/255 are not seen
GEOMETRY = "GeometryNodeTree"
SPACE = "dogsplat_space"  # of a group: the working space that it is for; without one it is Linear Rec.709
RADIANCE = ", radiance"  # ends the name of the space where the group is for linear models


def cached_group(name: str, space: str = "") -> bpy.types.NodeTree | None:
    """The group of that name, of this version and for that working space (``space.py``), if the file has it."""
    return next((g for g in bpy.data.node_groups
                 if is_current(g, name) and g.get(SPACE, "") == space and not g.library), None)  # fmt: skip


def is_current(group: bpy.types.NodeTree, name: str) -> bool:
    """Whether it is the group of that name as this version makes it."""
    return group.get("dogsplat") == f"{name} {VERSION}"


def version_of(group: bpy.types.NodeTree) -> int:
    """The version of the add-on's trees that one of ours is of."""
    return int(group["dogsplat"].rpartition(" ")[2])


def finish_group(tree: Tree, name: str, space: str = "") -> bpy.types.NodeTree:
    """Lay out a new group and mark it, so that it is found again."""
    arrange(tree.tree)
    tree.tree["dogsplat"] = f"{name} {VERSION}"
    if space:
        tree.tree[SPACE] = space
    return tree.tree


def multiplied(tree: Tree, color: Vector, matrix: np.ndarray) -> Vector:
    """A matrix [3, 3] times a colour."""
    return tree.combine(*(color.dot(tuple(row)) for row in matrix.tolist()))


def named_attribute(tree: Tree, name: str, kind: str = "FLOAT_VECTOR"):
    """A Named Attribute node: a float, a vector, or the socket as it is for colours and rotations."""
    return wrap(tree, attribute_socket(tree, name, kind))


def attribute_socket(tree: Tree, name: str, kind: str) -> bpy.types.NodeSocket:
    """The output of a Named Attribute node."""
    node = tree.node("GeometryNodeInputNamedAttribute", data_type=kind)
    node.inputs["Name"].default_value = name
    return node.outputs["Attribute"]


def average_brightness(tree: Tree) -> Value:
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
    axes = direction.normalized().split()
    powers: dict[tuple[int, int], Value] = {(axis, 1): axes[axis] for axis in range(3)}

    def power(axis: int, exponent: int) -> Value:
        if (axis, exponent) not in powers:
            powers[axis, exponent] = power(axis, exponent - 1) * axes[axis]
        return powers[axis, exponent]

    base = Vector(tree, named_attribute(tree, BASE, "FLOAT_COLOR"))
    color = base * C0 + (0.5, 0.5, 0.5)
    color = color + average_brightness(tree)  # 0 where no splat has curvatures
    for band in range(1, 4):
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
        assert total is not None
        color = color + total * (degree > band - 0.5)
    color = color.maximum((0.0, 0.0, 0.0))
    decoded = _srgb_to_linear(tree, color)
    if space:
        decoded = multiplied(tree, decoded, working_matrix())
    if space.endswith(RADIANCE):
        color = multiplied(tree, color, working_matrix())
    tree.plug(exit_node.inputs[0], switch(tree, "VECTOR", linear, color, decoded))
    return finish_group(tree, name, space)


def _srgb_to_linear(tree: Tree, color: Vector) -> Vector:
    channels = []
    for c in color.split():
        toe = c < KNEE
        curve = tree.math("POWER", (c + OFFSET) / SCALE, POWER)
        channels.append(c * toe / SLOPE + curve * (1.0 - toe))
    return tree.combine(*channels)


def linear_to_srgb(tree: Tree, color: Vector) -> Vector:
    """A colour that people picked, as the values that are blended."""
    channels = []
    for c in color.split():
        toe = c < LINEAR_KNEE
        curve = tree.math("POWER", tree.math("MAXIMUM", c, LINEAR_KNEE), 1 / POWER) * SCALE - OFFSET
        channels.append(c * toe * SLOPE + curve * (1.0 - toe))
    return tree.combine(*channels)


def kernel_group() -> bpy.types.NodeTree:
    """The 2D kernel of scaled axes that project to the columns of the rows V0, V1 (pixels).

    Σ' = V Vᵀ + 0.3 I; the kernel at offset (dx, dy) from its centre is exp(-(u² + v²) / 2) with u = ux dx + uy dy and
    v = vy dy. "Extent" is half the size of the box (x, y) outside of which opacity times kernel is below 1/255.
    """
    name = "DoG Splat kernel"
    if existing := cached_group(name):
        return existing
    sockets = {"V0": "NodeSocketVector", "V1": "NodeSocketVector", "Opacity": "NodeSocketFloat",
               "Antialiased": "NodeSocketBool"}  # fmt: skip
    results = {"Kernel": "NodeSocketVector", "Extent": "NodeSocketVector", "Opacity": "NodeSocketFloat"}
    tree, (v0, v1, opacity, antialiased), exit_node = new_group(name, GEOMETRY, sockets, results)
    raw_xx, raw_yy, xy, minors = v0.dot(v0), v1.dot(v1), v0.dot(v1), v0.cross(v1)
    raw_det = minors.dot(minors)  # Cauchy-Binet: xx yy - xy² would cancel on needles
    det = raw_det + (raw_xx + raw_yy) * LOW_PASS + LOW_PASS**2
    xx, yy = raw_xx + LOW_PASS, raw_yy + LOW_PASS
    ux = tree.math("SQRT", yy / det)
    uy = ux * xy / yy * -1.0
    vy = 1.0 / tree.math("SQRT", yy)
    shrunk = tree.math("SQRT", tree.math("MAXIMUM", raw_det / det, 2.5e-5)) - 1.0
    opacity = opacity * (shrunk * antialiased + 1.0)
    t = cutoff(tree, opacity)
    tree.plug(exit_node.inputs["Kernel"], tree.combine(ux, uy, vy))
    extent = tree.combine(tree.math("SQRT", t * xx), tree.math("SQRT", t * yy))
    tree.plug(exit_node.inputs["Extent"], extent)
    tree.plug(exit_node.inputs["Opacity"], opacity)
    return finish_group(tree, name)


def cutoff(tree: Tree, opacity: Value) -> Value:
    """r² at which opacity exp(-r² / 2) falls to 1/255; 0 where it never exceeds that."""
    level = tree.math("MAXIMUM", opacity * NEAREST_LEVEL, 1.0)
    return tree.math("LOGARITHM", level, 2.718281828459045) * 2.0

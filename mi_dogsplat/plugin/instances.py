"""Instances of ``dog`` shapes, which no integrator draws: Mitsuba does not say which group an instance shows."""

from __future__ import annotations

from typing import Any

import mitsuba as mi

from ..support.wording import counted
from .given_model import is_dog_shape

INSTANCE = "Instance"  # class of Mitsuba's shape ``instance``


def warn_of_instances(name: str, scene: mi.Scene) -> None:
    """A warning of Mitsuba's logger, in the ``name`` of a plugin, of what instances would show of ``dog`` shapes."""
    if not any(shape.class_name() == INSTANCE for shape in scene.shapes()):
        return
    nodes: Any = mi.traverse(scene).hierarchy
    # a shape of the scene that equals one of a group may be the same object, which the scene's own nodes have only once
    groups: list[Any] = [mi.traverse(node).hierarchy for node in nodes if isinstance(node, mi.Shape)]
    if grouped := len({shape for group in groups for shape in list(group)[1:] if is_dog_shape(shape)}):
        log: Any = mi.Log
        unseen = counted(grouped, "dog shape")
        remedy = "load its file once for each instance, with its own to_world"
        log(mi.LogLevel.Warn, f"{name}: instances do not show {unseen} in a shapegroup; {remedy}")

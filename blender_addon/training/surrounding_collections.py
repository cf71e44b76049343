"""The collections that an object is in, of which each may hide it."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

Chain = tuple[bpy.types.LayerCollection, ...]  # from that of the scene to one that holds the object


def chains(layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> list[Chain]:
    """Those of a view layer that it does not exclude."""
    return [chain for chain in _chains((layer.layer_collection,), obj) if not chain[-1].exclude]


def is_rendered(layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> bool:
    """Whether renders of a view layer have an object, unless it is hidden by itself."""
    return any(not any(part.collection.hide_render for part in chain) for chain in chains(layer, obj))


def _chains(chain: Chain, obj: bpy.types.Object) -> Iterator[Chain]:
    if obj in chain[-1].collection.objects.values():
        yield chain
    for child in chain[-1].children:
        yield from _chains((*chain, child), obj)

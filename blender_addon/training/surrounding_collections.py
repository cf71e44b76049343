"""The collections around objects, of which each may hide them."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

Chain = tuple[bpy.types.LayerCollection, ...]  # from that of the scene down to one that holds objects


def chains(layer: bpy.types.ViewLayer) -> list[Chain]:
    """To all collections that a view layer does not exclude."""
    return [chain for chain in _below((layer.layer_collection,)) if not chain[-1].exclude]


def rendered_objects(layer: bpy.types.ViewLayer) -> set[bpy.types.Object]:
    """Those that renders of a view layer have, unless they are hidden by themselves."""
    shown = (chain for chain in chains(layer) if not any(part.collection.hide_render for part in chain))
    return {obj for chain in shown for obj in chain[-1].collection.objects}


def _below(chain: Chain) -> Iterator[Chain]:
    yield chain
    for child in chain[-1].children:
        yield from _below((*chain, child))

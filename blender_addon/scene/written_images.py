"""The files that images were written to, so that no stage reads pixels again that are as they were.

Blender has no number that changes with the pixels of an image. It tells when one that it shows is painted or set up
differently, and tells of the node trees around one that is read again from its file. What scripts do to pixels it does
not tell, but it knows that they differ from the file. Where these were saved or packed, so is what is compared here.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from .export import Export

Use = tuple[Any, ...]  # what of an image, and how


class WrittenImages:
    """Of all images of the file that is open, by their full names."""

    def __init__(self) -> None:
        self._files: dict[str, tuple[tuple[Any, ...], dict[Use, str]]] = {}

    def file_of(self, export: Export, image: bpy.types.Image, use: Use, write: Callable[[], str]) -> str:
        """The name of the file for that use of an image in the folder of an export; ``write`` makes it."""
        origin = _origin(image)
        if origin is None:
            return write()
        known, files = self._files.get(image.name_full, (None, {}))
        if known != origin:
            files = {}
        if use not in files or not (export.folder / files[use]).exists():
            files[use] = write()
        self._files[image.name_full] = origin, files
        export.files.add(files[use])
        return files[use]

    def note(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Forget what Blender tells of: images, and those of node trees."""
        for update in depsgraph.updates:
            thing = update.id
            images = [thing] if isinstance(thing, bpy.types.Image) else []
            if isinstance(thing, bpy.types.NodeTree):
                images = [image for node in thing.nodes if (image := getattr(node, "image", None)) is not None]
            for image in images:
                self._files.pop(image.name_full, None)

    def forget(self) -> None:
        """All of them: another file has others."""
        self._files.clear()


WRITTEN = WrittenImages()


def _origin(image: bpy.types.Image) -> tuple[Any, ...] | None:
    """Where the pixels of an image come from; None where they are in memory alone, or others in each frame."""
    if image.is_dirty or image.source not in ("FILE", "GENERATED"):
        return None
    path, packed = Path(bpy.path.abspath(image.filepath, library=image.library)), image.packed_file
    found = path.stat() if image.filepath and path.is_file() else None
    return (
        path, found and (found.st_mtime_ns, found.st_size), packed and zlib.crc32(packed.data),
        image.source, tuple(image.size), image.is_float, image.colorspace_settings.name, image.alpha_mode,
        image.generated_type, tuple(image.generated_color),
    )  # fmt: skip


@persistent
def _evaluated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    WRITTEN.note(depsgraph)


@persistent
def _loaded(*_: Any) -> None:
    WRITTEN.forget()


def register() -> None:
    """The handlers."""
    bpy.app.handlers.depsgraph_update_post.append(_evaluated)
    bpy.app.handlers.load_post.append(_loaded)


def unregister() -> None:
    """The same backwards."""
    bpy.app.handlers.load_post.remove(_loaded)
    bpy.app.handlers.depsgraph_update_post.remove(_evaluated)
    WRITTEN.forget()

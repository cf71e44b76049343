"""What tells a scene from another one, or from itself before a change: digests of the files that it is made of."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .scene_file import files_read


def scene_digests(path: Path, defined: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Of a scene: ``scene_sha256`` of its XML files, and ``files_sha256`` of those that it names, by their names there.

    ``defined``: values of its parameters by their names. Raises ``DataError``.
    """
    texts, named = files_read(path, defined)
    digests: dict[str, Any] = {"scene_sha256": sha256(*texts)}
    if named:
        digests["files_sha256"] = {name: sha256(file) for name, file in named.items()}
    return digests


def sha256(*files: Path) -> str:
    """The digest of what is in some files, one after the other."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while part := file.read(1 << 20):
                digest.update(part)
    return digest.hexdigest()

"""The plain Gaussians that are nearest to a DoG model, by the package (``mi_dogsplat.export.bake``)."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ..files.errors import told
from ..files.model import Model
from ..files.ply import read_ply, write_ply
from ..package.renderers import RendererError, choose_renderer


def baked(command: str, model: Model) -> Model:
    """A model of as many plain Gaussians, in the same order; a model without DoG as it is.

    ``command`` is that of the preferences. Raises ``ValueError`` in one line where the package is not there.
    """
    if not model.is_dog.any():
        return model
    with tempfile.TemporaryDirectory(prefix="dogsplat_") as folder:
        path, out = Path(folder) / "dog.ply", Path(folder) / "plain.ply"
        write_ply(path, model)
        try:
            choose_renderer(command).convert(path, out, bake=True)
        except RendererError as error:
            problem = "only the package bakes DoG into plain Gaussians, and {reason}"
            raise ValueError(told(problem, reason=error)) from error
        return read_ply(out)

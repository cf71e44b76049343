"""Writes the reference of the Python interface, from docstrings, with pdoc.

    python -m scripts.release.api FOLDER [--without-source]

Half of the time goes into the source, which is coloured.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import mi_dogsplat  # noqa: F401  (before mitsuba: it chooses the LLVM)
import mitsuba as mi
import pdoc

# what docs/python.md names, and what an own program may build on; the rest is read in the source
MODULES = [
    "mi_dogsplat", "mi_dogsplat.integrator", "mi_dogsplat.shape_dog", "mi_dogsplat.scene", "mi_dogsplat.datasets",
    "mi_dogsplat.datasets.capture", "mi_dogsplat.datasets.capture_config", "mi_dogsplat.poses.run",
    "mi_dogsplat.poses.config", "mi_dogsplat.poses.scan", "mi_dogsplat.engine", "mi_dogsplat.reference",
    "mi_dogsplat.training", "mi_dogsplat.scores", "mi_dogsplat.render", "mi_dogsplat.runs",
    "mi_dogsplat.compare.compare", "mi_dogsplat.compare.names", "mi_dogsplat.measure.evaluate",
    "mi_dogsplat.measure.metrics", "mi_dogsplat.inspection", "mi_dogsplat.export.write",
    "mi_dogsplat.export.export_config", "mi_dogsplat.editing", "mi_dogsplat.film.make", "mi_dogsplat.film.film_config",
    "mi_dogsplat.meshing", "mi_dogsplat.masking", "mi_dogsplat.requests.serve", "mi_dogsplat.viewer.server",
    "mi_dogsplat.check.run", "mi_dogsplat.support.errors", "mi_dogsplat.support.settings",
    "mi_dogsplat.support.variants",
]  # fmt: skip


def write(folder: Path, source: bool) -> None:
    """Pages of HTML in ``folder``, which is made; ``source``: with that of functions and classes."""
    mi.set_variant("llvm_ad_rgb")  # the plugin classes derive from those of a variant
    # pdoc (16) looks up types in the wrong place for fields of a NamedTuple; it then shows them as they are written
    warnings.filterwarnings("ignore", "Error parsing type annotation", UserWarning)
    footer = "mi_dogsplat " + mi_dogsplat.__version__
    pdoc.render.configure(docformat="google", footer_text=footer, show_source=source)
    pdoc.pdoc(*MODULES, output_directory=folder)


if __name__ == "__main__":
    write(Path(sys.argv[1]), source="--without-source" not in sys.argv)

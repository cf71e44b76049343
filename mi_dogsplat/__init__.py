"""Mitsuba 3 plugins for Gaussian and Difference-of-Gaussians splatting, and the training of compact models.

``import mi_dogsplat`` registers the shape ``dog`` and the integrators ``dogsplat`` and ``dogpath``, before or after
``mi.set_variant(...)`` and again whenever the variant changes. Imported before ``mitsuba`` it also chooses an LLVM that
Dr.Jit can use.
"""

from .support.starting import end_when_interrupted

end_when_interrupted()  # what follows takes a second

from .support.llvm import check_loaded_llvm, choose_llvm  # noqa: E402

choose_llvm()  # Dr.Jit loads LLVM while it is imported: this comes first

import importlib  # noqa: E402
import sys  # noqa: E402

import mitsuba as mi  # noqa: E402

from .formats.model import Model  # noqa: E402
from .formats.read import read_model  # noqa: E402
from .formats.write import write_model  # noqa: E402
from .plugin.ellipsoids import to_ellipsoids  # noqa: E402
from .plugin.to_dog import to_dog  # noqa: E402
from .scene.drawing import Drawing  # noqa: E402
from .scene.ply import read_ply, write_ply  # noqa: E402
from .scene.splats import Splats  # noqa: E402
from .support.variants import register_unavailable, supported  # noqa: E402

__version__ = "0.1.0"
__all__ = [
    "Drawing", "Model", "Splats", "read_model", "read_ply", "to_dog", "to_ellipsoids", "write_model", "write_ply"
]  # fmt: skip

PLUGINS = ("shape_dog", "plugin.splat_integrator", "integrator", "plugin.dogpath")
DERIVED = ("requests.headlight",)  # classes of the variant that are no plugins, where somebody has imported them


def _register(old: str | None, new: str | None) -> None:
    """(Re)define the plugin classes: they derive from classes of the active variant."""
    if new is None or new == old:
        return
    if not supported(new):
        register_unavailable(new)
        return
    check_loaded_llvm()
    for name in (*PLUGINS, *DERIVED):
        full = f"{__name__}.{name}"
        if full in sys.modules:
            importlib.reload(sys.modules[full])
        elif name in PLUGINS:
            importlib.import_module(full)


mi.detail.add_variant_callback(_register)
_register(None, mi.variant())

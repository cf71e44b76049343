"""Which software made a result: what its numbers may depend on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version


def versions() -> dict[str, str]:
    """Versions of this package ("source" where it is not installed), of mitsuba, drjit and python."""
    try:
        own = version("mi_dogsplat")
    except PackageNotFoundError:
        own = "source"
    others = {"mitsuba": version("mitsuba"), "drjit": version("drjit")}
    return {"mi_dogsplat": own} | others | {"python": platform.python_version()}

"""All frozen functions of the package."""

from functools import cache
from importlib import import_module
from pathlib import Path

import mi_dogsplat
from mi_dogsplat.engine.frozen import Frozen


@cache
def frozen_functions() -> dict[str, Frozen]:
    package = Path(mi_dogsplat.__file__).parent
    users = [path for path in package.rglob("*.py") if "@frozen" in path.read_text(encoding="utf-8")]
    modules = [import_module(".".join(path.relative_to(package.parent).with_suffix("").parts)) for path in users]
    return {name: value for module in modules for name, value in vars(module).items() if isinstance(value, Frozen)}


def forget() -> None:
    for function in frozen_functions().values():
        function.clear()


def n_recordings() -> int:
    """Of all of them."""
    return sum(function.n_recordings for function in frozen_functions().values())

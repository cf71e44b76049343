"""How masks are found; what stands beside a field's type is the help text of its flag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from ..support.settings import Setting, check_settings

TIMES = "mask where the error is at least this many times the usual one of all photographs at that place of the scene"
MASKS = "folder of masks that exist already, named like the images; what is black there stays black and is ignored"


@dataclass(frozen=True)
class MasksConfig:
    """Raises ``DataError`` (a ``ValueError``) that names the flag, its value and what is allowed."""

    times: Annotated[float, Setting(TIMES, "X", least=2.5, most=100)] = 5.0
    masks: Annotated[str | None, Setting(MASKS, "FOLDER")] = None

    def __post_init__(self) -> None:
        check_settings(self)

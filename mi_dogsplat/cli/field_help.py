"""Comments of the fields of a settings class as help texts: settings live, and are explained, in one place."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path


def field_help(settings: type) -> dict[str, str]:
    """Help text of each field of a dataclass, from the comment on its line."""
    source = Path(sys.modules[settings.__module__].__file__ or "").read_text(encoding="utf-8")
    names = {field.name for field in dataclasses.fields(settings)}
    lines = (line.strip() for line in source.splitlines() if "  # " in line and ":" in line)
    pairs = ((line.split(":", 1)[0], line.split("  # ", 1)[1].strip()) for line in lines)
    return {name: text for name, text in pairs if name in names}

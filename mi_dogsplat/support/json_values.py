"""Numbers in JSON objects, and how errors quote what is none."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def number_in(content: Mapping[str, Any], key: str, default: float | None = None) -> float:
    """What an object has under a key, or the default. Raises ``ValueError`` that names the key."""
    value = content.get(key, default)
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f'"{key}" is {in_json(value)}, no number') from None


def in_json(value: Any) -> str:
    """A value as its file has it, or how it begins."""
    return f"{json.dumps(value):.80}"

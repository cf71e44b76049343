"""JSON files of cameras: what is wrong with one is said in a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..files.errors import FileError

KINDS = "a folder with sparse/0, transforms.json or transforms_train.json, such a file, or a run folder"


def read_json_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file. Raises ``FileError``."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise FileError(path, f"not valid JSON in line {error.lineno} ({error.msg})", "correct that line") from error
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, f"cannot be read ({error})", "give a text file in UTF-8") from error
    if not isinstance(content, dict):
        raise FileError(path, "is not a JSON object", f"give {KINDS}")
    return content

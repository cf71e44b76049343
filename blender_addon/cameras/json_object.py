"""JSON files of cameras: what is wrong with one is said in a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..files.errors import FileError

KINDS = "give a folder with sparse/0, transforms.json or transforms_train.json, such a file, or a run folder"


def read_json_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file. Raises ``FileError``."""
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))  # editors of Windows begin a file with a mark
    except json.JSONDecodeError as error:
        problem = "not valid JSON in line {line} ({reason})"
        raise FileError(path, problem, "correct that line", line=error.lineno, reason=error.msg) from error
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "cannot be read ({reason})", "give a text file in UTF-8", reason=error) from error
    if not isinstance(content, dict):
        raise FileError(path, "is not a JSON object", KINDS)
    return content

"""What happened in a training, as the records in the rows of its history tell."""

import json
from pathlib import Path


def history_of(run: Path) -> list[dict]:
    """The rows of a run folder."""
    return [json.loads(line) for line in (run / "history.jsonl").read_text(encoding="utf-8").splitlines()]


def records(rows: list[dict], *kinds: str) -> list[dict]:
    """Of these kinds, in order."""
    return [record for row in rows for record in row.get("events", ()) if record["kind"] in kinds]


def rows_with(rows: list[dict], *kinds: str) -> list[dict]:
    """Rows with a record of one of these kinds."""
    return [row for row in rows if records([row], *kinds)]

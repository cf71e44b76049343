"""What happened in a training, as the records in the rows of its history tell."""


def records(rows: list[dict], *kinds: str) -> list[dict]:
    """Of these kinds, in order."""
    return [record for row in rows for record in row.get("events", ()) if record["kind"] in kinds]


def rows_with(rows: list[dict], *kinds: str) -> list[dict]:
    """Rows with a record of one of these kinds."""
    return [row for row in rows if records([row], *kinds)]

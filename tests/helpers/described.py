"""Lines of ``dogsplat info``."""


def value_of(lines: list[str], name: str) -> str:
    """What a line says of a name."""
    return next(line[18:] for line in lines if line.startswith(f"  {name} "))


def stated(lines: list[str]) -> dict[str, tuple[str, str]]:
    """State and reason of each feature, with ``--features``."""
    rows = [line for line in lines if line.startswith("  ")]
    return {row[:28].strip(): tuple(row[28:].split(": ", 1)) for row in rows}  # pyright: ignore[reportReturnType]

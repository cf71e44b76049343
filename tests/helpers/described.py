"""Lines of ``dogsplat info``."""


def value_of(lines: list[str], name: str) -> str:
    """What a line says of a name."""
    return next(line[18:] for line in lines if line.startswith(f"  {name} "))

"""The layout is the journey of the data: low stations never import high ones."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "mi_dogsplat"

# From low to high; modules of one row may import each other. A module may import its own row and those above it here.
STATIONS = [
    {"support"},
    {"scene"},
    {"datasets"},
    {"reference"},
    {"engine"},
    {"shape_dog", "plugin", "integrator"},
    {"scores"},
    {"render"},
    {"measure"},
    {"training"},
    {"report"},
    {"runs"},
    {"ablation"},
    {"compare"},
    {"inspection"},
    {"check"},
    {"export"},
    {"viewer"},
    {"cli"},
    {"demo"},
]
LEVEL = {name: level for level, names in enumerate(STATIONS) for name in names}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p.stem not in ("__init__", "__main__") or p.parent != PACKAGE)


def station(path: Path) -> str:
    """The module, or the folder of modules, directly under the package."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imported_stations(path: Path) -> set[str]:
    """Stations that a file imports anywhere, inside of functions too, but not for type checking only."""
    found = set()
    package = ("mi_dogsplat", *path.relative_to(PACKAGE).parent.parts)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for_types = {id(child) for node in ast.walk(tree)
                 if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
                 for child in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in for_types:
            continue
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(package[:len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            names = [[*base, alias.name] for alias in node.names]
        found |= {name[1] for name in names if len(name) > 1 and name[0] == "mi_dogsplat"}
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_station_imports_no_higher_one(path):
    own = station(path)
    assert own in LEVEL, f"{own} has no place among the stations; give it one in {Path(__file__).name}"
    higher = {name for name in imported_stations(path) if LEVEL.get(name, -1) > LEVEL[own]}
    assert not higher, f"{own} imports {', '.join(sorted(higher))}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_nothing_but_checks_imports_the_reference(path):
    """What is tested against it has nothing from it: a mistake there would be on both sides, and invisible."""
    if station(path) not in ("reference", "check"):
        assert "reference" not in imported_stations(path)


def test_every_station_exists():
    there = {station(path) for path in MODULES}
    assert set(LEVEL) <= there, f"no longer there: {', '.join(sorted(set(LEVEL) - there))}"


def test_models_files_and_data_sets_are_read_without_mitsuba():
    """Up to the data sets nothing imports Mitsuba or Dr.Jit when it is imported itself."""
    for path in MODULES:
        if LEVEL.get(station(path), 99) > LEVEL["datasets"] or path.stem in ("llvm", "variants"):
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            heavy = {name.split(".")[0] for name in names} & {"mitsuba", "drjit"}
            assert not heavy, f"{path.relative_to(PACKAGE)} imports {', '.join(heavy)}"

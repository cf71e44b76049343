"""The layout is the journey of the data: low stations never import high ones, and no two modules need each other."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "mi_dogsplat"

# From low to high; modules of one row may import each other. A module may import its own row and those above it here.
STATIONS = [
    {"support"},
    {"scene"},
    {"formats"},
    {"datasets"},
    {"poses"},
    {"reference"},
    {"engine"},
    {"tracing"},
    {"shape_dog", "plugin", "integrator"},
    {"scores"},
    {"render"},
    {"requests"},
    {"measure"},
    {"training"},
    {"report"},
    {"runs"},
    {"compare"},
    {"inspection"},
    {"check"},
    {"film"},
    {"export"},
    {"editing"},
    {"viewer"},
    {"cli"},
    {"demo"},
]
LEVEL = {name: level for level, names in enumerate(STATIONS) for name in names}
MODULES = sorted(p for p in PACKAGE.rglob("*.py") if p.stem not in ("__init__", "__main__") or p.parent != PACKAGE)


def station(path: Path) -> str:
    """The module, or the folder of modules, directly under the package."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def module_of(path: Path) -> str:
    """Its name within the package, with dots; a folder for its ``__init__``."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_of(path) for path in PACKAGE.rglob("*.py")}


def imported_modules(path: Path) -> set[str]:
    """Modules of the package that a file imports anywhere, inside of functions and for type checking too."""
    found = set()
    package = ("mi_dogsplat", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name.split(".") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(package[:len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            names = [[*base, alias.name] for alias in node.names]
        for name in (name[1:] for name in names if len(name) > 1 and name[0] == "mi_dogsplat"):
            while ".".join(name) not in NAMES:  # something in a module
                name = name[:-1]
            found.add(".".join(name))
    return found - {""}


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Nodes that need each other, in order, the first one again at the end; none if there are none."""
    done: set[str] = set()

    def visit(node: str, way: list[str]) -> list[str]:
        if node in way:
            return [*way[way.index(node):], node]
        if node in done:
            return []
        for other in sorted(graph[node]):
            if found := visit(other, [*way, node]):
                return found
        done.add(node)
        return []

    return next((found for node in sorted(graph) if (found := visit(node, []))), [])


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_station_imports_no_higher_one(path):
    own = station(path)
    assert own in LEVEL, f"{own} has no place among the stations; give it one in {Path(__file__).name}"
    imported = {name.split(".")[0] for name in imported_modules(path)}
    higher = {name for name in imported if LEVEL.get(name, -1) > LEVEL[own]}
    assert not higher, f"{own} imports {', '.join(sorted(higher))}"


def test_no_two_modules_need_each_other():
    assert not cycle({module_of(path): imported_modules(path) - {module_of(path)} for path in PACKAGE.rglob("*.py")})


def test_no_folder_within_a_room_needs_what_needs_it():
    """As ``training/strategy``: what it stands on knows nothing of it."""

    def whole(name: str) -> str:
        return name.rpartition(".")[0] if name.count(".") > 1 else name

    graph: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        node = whole(module_of(path))
        graph.setdefault(node, set()).update({whole(name) for name in imported_modules(path)} - {node})
    assert not cycle(graph)


def test_a_cycle_is_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_nothing_but_checks_imports_the_reference(path):
    """What is tested against it has nothing from it: a mistake there would be on both sides, and invisible."""
    if station(path) not in ("reference", "check"):
        assert "reference" not in {name.split(".")[0] for name in imported_modules(path)}


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

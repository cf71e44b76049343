"""The layout is the journey of the data: low stations never import high ones, and no two modules need each other."""

import ast
from pathlib import Path

import pytest
from layout import Layout, cycle
from mi_dogsplat.report import run_folder

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
    {"meshing"},
    {"masking"},
    {"viewer"},
    {"cli"},
    {"demo"},
]
LAYOUT = Layout(Path(__file__).parents[2] / "mi_dogsplat", STATIONS)


def test_a_station_imports_no_higher_one():
    LAYOUT.require_order()


def test_no_two_modules_need_each_other():
    assert not LAYOUT.cycle_of_modules()


def test_no_folder_within_a_room_needs_what_needs_it():
    """As ``training/strategy``: what it stands on knows nothing of it."""
    assert not LAYOUT.cycle_of_folders()


def test_every_station_exists():
    LAYOUT.require_rooms()


def test_the_tests_have_the_folders_of_what_they_test():
    tests = Path(__file__).parents[1]
    of_others = {"benchmarks", "blender", "fuzz", "project"}  # nothing of the package, or all of it
    folders = {path.parent.relative_to(tests) for path in tests.rglob("test_*.py")}
    assert len(folders) > 20
    of_the_package = [folder for folder in folders if folder.parts[0] not in of_others]
    assert not [folder for folder in of_the_package if not (LAYOUT.root / folder).is_dir()]


def test_a_cycle_is_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_an_import_from_a_higher_room_is_found(tmp_path):
    """Relative or not, at the top or inside of a function."""
    package = tmp_path / "sample"
    inside = "def f():\n    from ..high import c\n"
    files = {"low/a": "", "low/b": inside, "high/c": "from ..low.a import x\n", "low/d": "import sample.high.c\n"}
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / f"{name}.py").write_text(text)
        (package / name).with_name("__init__.py").write_text("")
    layout = Layout(package, [{"low"}, {"high"}])
    layout.require_order(*(package / f"{name}.py" for name in ("low/a", "high/c")))
    for name in ("low/b", "low/d"):
        with pytest.raises(AssertionError, match="low imports high"):
            layout.require_order(package / f"{name}.py")
    with pytest.raises(AssertionError, match="low has no place"):
        Layout(package, [{"high"}]).require_order(package / "low/a.py")
    with pytest.raises(AssertionError, match="no longer there: middle"):
        Layout(package, [{"low"}, {"middle"}, {"high"}]).require_rooms()


def test_nothing_but_checks_imports_the_reference():
    """What is tested against it has nothing from it: a mistake there would be on both sides, and invisible."""
    others = [path for path in LAYOUT.modules if LAYOUT.room(path) not in ("reference", "check")]
    assert not [path for path in others if "reference" in LAYOUT.imported_rooms(path)]


def test_the_files_of_a_run_folder_are_named_in_one_place():
    """All but config.json: comparisons have one too."""
    names = {run_folder.MODEL, run_folder.HISTORY, run_folder.METRICS, run_folder.REPORT}

    def names_one(path: Path) -> bool:
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        return any(isinstance(node, ast.Constant) and node.value in names for node in nodes)

    assert list(filter(names_one, LAYOUT.modules)) == [LAYOUT.root / "report" / "run_folder.py"]


def test_models_files_and_data_sets_are_read_without_mitsuba():
    """Up to the data sets nothing imports Mitsuba or Dr.Jit when it is imported itself."""
    for path in LAYOUT.modules:
        if LAYOUT.level.get(LAYOUT.room(path), 99) > LAYOUT.level["datasets"] or path.stem in ("llvm", "variants"):
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            heavy = {name.split(".")[0] for name in names} & {"mitsuba", "drjit"}
            assert not heavy, f"{path.relative_to(LAYOUT.root)} imports {', '.join(heavy)}"

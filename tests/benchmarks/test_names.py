"""``python -m benchmarks`` finds what it lists, and lists all that can be run."""

from pathlib import Path

from benchmarks.names import EXPERIMENTS, ROOM_OF, TIMINGS

ROOT = Path(__file__).parents[2] / "benchmarks"


def test_every_name_is_a_module_in_its_room():
    missing = [name for name, room in ROOM_OF.items() if not (ROOT / room / f"{name}.py").exists()]
    assert not missing


def test_every_module_with_a_main_is_listed():
    mains = {path for path in ROOT.glob("*/*.py") if "\ndef main(" in path.read_text(encoding="utf-8")}
    assert {path.stem for path in mains} == set(ROOM_OF)


def test_no_experiment_is_a_timing():
    """Which take no flags of their own."""
    assert not set(TIMINGS) & {name for names in EXPERIMENTS.values() for name in names}

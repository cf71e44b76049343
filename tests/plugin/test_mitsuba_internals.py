"""What Mitsuba and Dr.Jit show without promising it: each is used in one file, and is here as it was in 3.9.

What the engine uses of Dr.Jit is in ``tests/engine/test_drjit_internals.py``.
"""

import re
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest
from mi_dogsplat.plugin.film import pixel_format_of
from splat_scenes import dog_dict, random_splats, rounded

PACKAGE = Path(__file__).parents[2] / "mi_dogsplat"
INTERNALS = {
    "mi.detail.add_variant_callback": "__init__.py",
    "drjit.detail.llvm_version": "support/llvm.py",
    "str(film)": "plugin/film.py",
}
MODEL = rounded(random_splats(3, seed=1))
VERSIONS = f"this is Mitsuba {mi.__version__}; it was so in 3.9"


@pytest.mark.parametrize("name", INTERNALS)
def test_each_is_used_in_one_file(name):
    users = [p.relative_to(PACKAGE).as_posix() for p in PACKAGE.rglob("*.py") if name in p.read_text(encoding="utf-8")]
    assert users == [INTERNALS[name]]


def test_there_are_no_others_outside_of_the_engine():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] != "engine":
            found |= set(re.findall(r"\b\w+\.detail\.\w+", path.read_text(encoding="utf-8")))
    assert found == {name for name in INTERNALS if ".detail." in name}


@pytest.mark.parametrize("pixel_format", ["rgb", "rgba", "luminance", "luminance_alpha", "xyz"])
def test_a_film_tells_its_pixel_format_in_its_description_only(pixel_format):
    film: Any = mi.load_dict({"type": "hdrfilm", "pixel_format": pixel_format})
    assert pixel_format_of(film) == pixel_format, VERSIONS
    assert not any("format" in name for name in dir(film) if name[0] != "_"), f"there is a better way now: {VERSIONS}"


def test_the_version_of_llvm_is_three_numbers():
    assert [type(n) for n in dr.detail.llvm_version()] == [int] * 3, VERSIONS


def test_a_mitsuba_that_has_no_meshes_by_counts_gets_its_triangle_as_fields(monkeypatch):
    """As the development notes of Mitsuba 3.10 have it; the triangle is there from the start in 3.9."""
    shape: Any = mi.load_dict(dog_dict(MODEL))
    assert (shape.vertex_count(), shape.face_count()) == (3, 1), VERSIONS
    given = {}
    monkeypatch.setattr(type(shape), "from_fields", lambda self, **fields: given.update(fields), raising=False)
    assert mi.load_dict(dog_dict(MODEL)).class_name() == shape.class_name()
    assert given["faces"].shape == (1, 3) and given["positions"].shape == (3, 3)
    assert not given["positions"].numpy().any()

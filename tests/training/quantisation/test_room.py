"""A palette is larger where the file has room for it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mi_dogsplat.formats.grids import MOST_ENTRIES
from mi_dogsplat.formats.sizes import FileKind
from mi_dogsplat.formats.sog import MAX_PALETTE
from mi_dogsplat.scene.splats import Splats
from mi_dogsplat.training.presets import RECIPES
from mi_dogsplat.training.quantisation import room
from mi_dogsplat.training.quantisation.room import FILLED, Room
from mi_dogsplat.training.strategy.quantise import Quantisation
from mi_dogsplat.training.strategy.sieve import Sieve
from splat_scenes import random_splats, rounded

SOG = FileKind("sog")
USUAL = 1024  # entries, in place of MOST_ENTRIES: palettes of more take seconds
MANY = 3750  # of which a palette would have 1406 entries


@pytest.fixture
def many(monkeypatch) -> Splats:
    monkeypatch.setattr(room, "MOST_ENTRIES", USUAL)
    return rounded(random_splats(MANY, seed=0, degree=1, dog_share=0))


@pytest.fixture
def size(many) -> int:
    """Of the file with a larger palette."""
    return SOG.size(SOG.foreseen(many, 2 * USUAL))


def test_a_file_with_room_has_a_larger_palette(many, size):
    distinct = len(np.unique(SOG.foreseen(many, 2 * USUAL).sh_coeffs[:, 1:], axis=0))
    assert USUAL < distinct <= 0.375 * MANY
    assert Room(int(1.01 * size / FILLED), SOG).most_entries(many) == 2 * USUAL


def test_one_that_is_nearly_full_has_the_usual_palette(many, size):
    assert SOG.size(SOG.foreseen(many, USUAL)) < size
    assert Room(int(0.99 * size / FILLED), SOG).most_entries(many) == USUAL


@pytest.mark.parametrize(("degrees", "most"), [
    ([3] * 20_000, MOST_ENTRIES), ([0] * 400_000, MOST_ENTRIES), ([1] * 40_000, 2 * MOST_ENTRIES),
    ([3] * 400_000, MAX_PALETTE), ([1] * 200_000 + [2] * 200_000, MAX_PALETTE // 2),
])  # fmt: skip
def test_no_more_entries_than_primitives_need_or_labels_can_name(degrees, most, monkeypatch):
    """A file without end; of so many primitives a palette would have 7,500, no, 15,000, 150,000 and 2 x 75,000."""
    monkeypatch.setattr(FileKind, "foreseen", lambda kind, splats, most: splats)
    monkeypatch.setattr(FileKind, "size", lambda kind, splats: 0)
    splats: Any = SimpleNamespace(sh_degrees=np.array(degrees))
    assert Room(10**9, SOG).most_entries(splats) == most


def test_only_a_training_for_a_size_has_room():
    recipe = RECIPES["ours"].for_format("sog")
    (free,) = (s for s in recipe.strategies(Sieve()) if isinstance(s, Quantisation))
    (held,) = (s for s in recipe.strategies(Sieve(), (10**6, SOG)) if isinstance(s, Quantisation))
    assert free.room is None and held.room == Room(10**6, SOG)
    assert held.quantiser.room == held.room
    (other,) = (s for s in recipe.strategies(Sieve(), (10**6, FileKind("ply"))) if isinstance(s, Quantisation))
    assert other.room is None  # the file is of another kind than the numbers

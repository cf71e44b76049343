"""Which methods a comparison offers, by which names, and what each rival deviates in."""

from pathlib import Path

import pytest
from mi_dogsplat.compare.methods import GROUPS, METHODS
from mi_dogsplat.compare.names import ABLATION, ALL, EQUAL, PUBLISHED, RIVALS, SHORTER, chosen


def test_the_command_line_offers_all_methods_in_order_and_sets_of_them():
    assert list(METHODS) == list(ALL) and len(set(ALL)) == len(ALL)
    assert sorted(METHODS) == sorted(name for members in GROUPS.values() for name in members)
    assert set(METHODS) == {*PUBLISHED, *EQUAL, *ABLATION, *SHORTER}
    assert chosen(["ours", "ablation", "3dgs"]) == [name for name in ALL if name in ABLATION]
    assert chosen(["equal", "published"]) == [name for name in ALL if name in {*EQUAL, *PUBLISHED}]
    with pytest.raises(ValueError, match="best"):
        chosen(["ours", "best"])


def test_every_rival_has_a_row_with_our_window_and_step_sizes_and_says_in_what_it_deviates():
    ours = METHODS["ours"].recipe
    for name in RIVALS:
        equal, published = METHODS[name + "_equal"], METHODS[name]
        assert equal.recipe.refinement == ours.refinement and equal.recipe.dog is None
        if equal.recipe.pruning:
            assert equal.recipe.pruning.stop == ours.pruning.stop  # type: ignore[union-attr]
        assert "window and step sizes are ours" in equal.deviations and published.deviations in equal.deviations
    assert all(METHODS[name].deviations for name in RIVALS if name not in ("opacity", "3dgs_capped"))


def test_the_docs_have_every_rival_with_all_that_it_deviates_in():
    text = (Path(__file__).parents[2] / "docs" / "compare.md").read_text(encoding="utf-8")
    lines = {line.split("|")[1].strip(" `"): line for line in text.splitlines() if line.startswith("| `")}
    for name in (*RIVALS, "paper", "released", "released_40k"):
        assert METHODS[name].deviations in lines[name], name

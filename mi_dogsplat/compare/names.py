"""Names of all methods, and of sets of them: what ``--only`` knows, without what it takes to run them."""

from __future__ import annotations

from collections.abc import Sequence

SUFFIX = "_equal"  # of a method with our window and step sizes
AT = "@"  # before the target of a run that has not that of the comparison, as in ours@0.05
RIVALS = (
    *("opacity", "radsplat", "mini_splatting", "lightgaussian", "pup", "speedy_splat"),
    *("mask_gaussian", "lp_3dgs", "gaussian_spa", "gns"),
    *("taming", "dash", "mcmc", "improved_gs", "3dgs_capped"),
)
OURS = ("ours", "ours_slopes", "ours_cuts", "ours_preconditioned", "ours_second_cuts", "ours_curvatures", "ours_shifts")
"""Each adds to the one before it."""
EARLY = ("3dgs_early", "ours_early")  # with a shorter growth of their own
PUBLISHED = ("3dgs", *RIVALS, "paper", "released", "released_40k", "ours_published", *OURS)
EQUAL = (
    *("3dgs_equal", *(name + SUFFIX for name in RIVALS), "paper_equal", "released_equal"),
    *("ours_gaussian", *OURS),
)
ABLATION = ("3dgs", "v1", "v2", "v3", "full", "released", "ours_gaussian", *OURS)
SHORTER = ("3dgs", "3dgs_equal", "ours_shifts", *EARLY)  # by how much a shorter growth gains
SETS = {"published": PUBLISHED, "equal": EQUAL, "ablation": ABLATION, "early": SHORTER}
ALL = (
    *("3dgs", *RIVALS, "v1", "v2", "v3", "full", "paper", "released", "released_40k"),
    *(name for name in EQUAL if name.endswith(SUFFIX)),
    *("ours_published", "ours_gaussian", *OURS),
    *EARLY,
)  # in the order of the table


def chosen(words: Sequence[str]) -> list[str]:
    """The methods that are meant by names of methods and of sets, in the order of the table, each once.

    Raises ``ValueError`` with the word that is neither.
    """
    names: set[str] = set()
    for word in words:
        if word not in SETS and word not in ALL:
            raise ValueError(word)
        names.update(SETS.get(word, (word,)))
    return [name for name in ALL if name in names]


def at_target(name: str, target: float) -> str:
    """The name of a method with another target, which is behind ``AT``, exactly."""
    short = f"{target:g}"
    return f"{name}{AT}{short if float(short) == target else repr(target)}"


def seed_order(seed: str) -> tuple[int, str]:
    """By which seeds are sorted, as numbers: 2 comes before 10."""
    return len(seed), seed


def method_of(name: str) -> str:
    """The method, without a target."""
    return name.partition(AT)[0]

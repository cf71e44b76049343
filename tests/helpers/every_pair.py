"""Cases of a test with many parameters: fewer than their full product, nearly each of which compiles kernels."""

import itertools
from collections.abc import Iterable
from typing import Any

import pytest


def every_pair(**parameters: Iterable[Any]) -> pytest.MarkDecorator:
    """Parametrises a test so that each value of a parameter meets each value of every other one in some case.

    A fault takes one value, or two that meet; in the full product the same two meet again and again. Greedy: the case
    with most pairs that are still missing is next, the first of the product where several have as many.
    """
    columns = [list(values) for values in parameters.values()]
    product = list(itertools.product(*(range(len(values)) for values in columns)))

    def pairs(case: tuple[int, ...]) -> set[tuple]:
        return set(itertools.combinations(enumerate(case), 2))

    cases: list[tuple[int, ...]] = []
    missing = set().union(*map(pairs, product))
    while missing:
        cases.append(max(product, key=lambda case: len(missing & pairs(case))))
        missing -= pairs(cases[-1])
    return pytest.mark.parametrize(list(parameters), [[*map(list.__getitem__, columns, case)] for case in cases])

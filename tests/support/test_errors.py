"""Errors that other errors wrap, as Dr.Jit does where it renders: what was first is found, whatever leads to it."""

from __future__ import annotations

import pytest
from mi_dogsplat.support.errors import gist, interruptible


class Wrapping(RuntimeError):
    """One whose cause is set as C++ does it, to what it likes; it tells it a hundred times at most."""

    def __init__(self, text: str):
        super().__init__(text)
        self.cause: BaseException | None = None
        self.left = 100

    @property
    def __cause__(self) -> BaseException | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        self.left -= 1
        return self.cause if self.left > 0 else None


def circle() -> tuple[Wrapping, Wrapping]:
    """Two errors, each the cause of the other."""
    one, other = Wrapping("see above"), Wrapping("the first")
    one.cause, other.cause = other, one
    return one, other


def test_ctrl_c_is_found_where_errors_that_wrap_it_are_causes_of_each_other():
    one, other = circle()
    other.__context__ = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt), interruptible():
        raise one


def test_errors_that_are_causes_of_each_other_without_ctrl_c_go_on_as_they_are():
    one, other = circle()
    with pytest.raises(Wrapping) as caught, interruptible():
        raise one
    assert caught.value is one and other.left > 0


def test_the_gist_of_errors_that_are_causes_of_each_other_is_the_last_before_the_circle_closes():
    one, other = circle()
    assert gist(one) == "the first" and other.left > 0

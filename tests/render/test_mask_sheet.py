"""The sheet of photographs and what is masked in them."""

import numpy as np
from mi_dogsplat.render.mask_sheet import CELL, COLUMNS, ROWS, STRENGTH, TINT, mask_sheet


def photographs(n: int):
    for k in range(n):
        masked = np.zeros((60, 80), bool)
        masked[:, :40] = True
        yield np.full((120, 160, 3), 0.2 + 0.01 * k), masked, f"photograph {k}"


def test_what_is_masked_is_half_red_and_the_rest_as_it_was():
    page = mask_sheet(photographs(1))
    assert page.shape[1] == CELL and page.shape[0] > 180
    assert np.abs(page[10:170, 10:110] - (STRENGTH * TINT + (1 - STRENGTH) * 0.2)).max() < 0.01
    np.testing.assert_allclose(page[10:170, 130:230], 0.2, atol=0.01)
    assert page[181:].min() < 0.3  # its name


def test_there_are_rows_of_the_first_few():
    page = mask_sheet(photographs(COLUMNS * ROWS + 3))
    height = mask_sheet(photographs(1)).shape[0]
    assert page.shape[:2] == (ROWS * height, COLUMNS * CELL)
    for k in range(COLUMNS * ROWS):
        cell = page[k // COLUMNS * height :, k % COLUMNS * CELL :]
        np.testing.assert_allclose(cell[20, 200], 0.2 + 0.01 * k, atol=0.005)
    assert (mask_sheet(photographs(COLUMNS + 1))[height:, CELL:] == 1).all()


def test_photographs_of_different_shapes_have_room():
    tall = np.full((160, 80, 3), 0.5), np.zeros((160, 80), bool), "tall"
    page = mask_sheet([tall, *photographs(1)])
    assert page.shape[0] > CELL
    np.testing.assert_allclose(page[10:230, 10:110], 0.5, atol=0.01)
    assert (page[:CELL, 121:238] == 1).all()
    np.testing.assert_allclose(page[20, 440], 0.2, atol=0.01)

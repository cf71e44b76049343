"""Several models as one: every primitive is told by itself, before and after."""

from typing import Any

import numpy as np
import pytest
from mi_dogsplat.scene.splats import Splats
from splat_scenes import random_splats, rounded

ROWS = {
    "dog_index": ("dog_logit_opacities", "dog_log_scales"),
    "slope_index": ("color_slopes",),
    "curvature_index": ("brightness_curvatures",),
    "cut_index": ("cut_normals",),
    "second_cut_index": ("second_cut_normals",),
}
EVERYTHING: dict[str, Any] = {f"{kind}_share": 0.5 for kind in ("dog", "slope", "curvature", "cut", "second_cut")}


def told(splats: Splats) -> list[dict]:
    """Each primitive alone: its numbers, its rows where it has some, its SH degree and coefficients."""
    found = []
    for i in range(splats.n_splats):
        one: dict = {name: getattr(splats, name)[i].tolist() for name in
                     ("means", "log_scales", "quats", "logit_opacities")}  # fmt: skip
        for index, names in ROWS.items():
            at = getattr(splats, index).tolist()
            one |= {name: getattr(splats, name)[at.index(i)].tolist() for name in names if i in at}
        sh = splats.sh_coeffs[i].tolist()
        for degree in (1, 2, 3):
            at = getattr(splats, f"sh{degree}_index").tolist()
            if i in at:
                sh = sh + getattr(splats, f"sh{degree}_coeffs")[at.index(i)].tolist()
        found.append(one | {"sh": sh})
    return found


def model(n: int, seed: int, degree: int = 3, **rows) -> Splats:
    return rounded(random_splats(n, seed, degree, **{"dog_share": 0, **rows}))


def mixed(n: int, seed: int) -> Splats:
    return model(n, seed, **EVERYTHING).with_sh_degrees(np.arange(n) % 4)


@pytest.mark.parametrize(
    "parts",
    [
        [model(9, 1, **EVERYTHING), model(7, 2, **EVERYTHING)],
        [model(5, 1), model(7, 2, **EVERYTHING), model(4, 3, cut_share=0.5)],
        [mixed(9, 1), mixed(6, 2)],
        [model(4, 1, 2), mixed(9, 2), model(3, 3, 0), model(5, 4, 2)],
        [model(4, 1, 0), model(5, 2, 3, **EVERYTHING), model(3, 3, 1)],
        [Splats.empty(3), model(4, 1, 1), Splats.empty(0), model(3, 2, 1)],
        [mixed(6, 1)],
    ],
    ids=["alike", "some rows", "mixed", "mixed and uniform", "degrees", "empty", "alone"],
)
def test_every_primitive_is_as_it_was(parts):
    joined = parts[0].joined(*parts[1:])
    assert told(joined) == [one for part in parts for one in told(part)]
    assert joined.sh_degrees.tolist() == [degree for part in parts for degree in part.sh_degrees]
    assert not any(np.shares_memory(getattr(joined, name), array)
                   for part in parts for name, array in vars(part).items())  # fmt: skip


def test_it_is_uniform_where_its_parts_have_one_degree_and_padded_on_request():
    alike = model(4, 1, 2).joined(Splats.empty(0), model(3, 2, 2))
    assert not alike.mixed_sh and alike.sh_coeffs.shape == (7, 9, 3)
    different = model(4, 1, 2).joined(model(3, 2, 1))
    assert different.mixed_sh and different.uniform_sh().sh_coeffs.shape == (7, 9, 3)
    assert not different.uniform_sh().sh_coeffs[4:, 4:].any()


def test_nothing_joined_with_nothing_is_nothing_of_the_first_degree():
    joined = Splats.empty(2).joined(Splats.empty(3))
    assert (joined.n_splats, joined.sh_degree, joined.mixed_sh) == (0, 2, False)

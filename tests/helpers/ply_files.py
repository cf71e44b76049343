"""PLY files built by hand for the tests, independently of the code under test."""

from pathlib import Path

import numpy as np
from mi_dogsplat.scene.row_groups import CUTS, RowGroup
from mi_dogsplat.scene.splats import Splats

DOG = ["dog_opacity", "dog_scale_0", "dog_scale_1", "dog_scale_2"]
CODES = {"float": "f4", "float32": "f4", "double": "f8", "uint": "u4", "int": "i4", "uchar": "u1", "ushort": "u2"}


def random_splats(n=7, sh_degree=3, dog_index=(0, 3, 4), seed=0) -> Splats:
    rng = np.random.default_rng(seed)
    k = (sh_degree + 1) ** 2
    m = len(dog_index)
    return Splats(
        means=rng.normal(size=(n, 3)),
        log_scales=rng.normal(size=(n, 3)),
        quats=rng.normal(size=(n, 4)) * 10,
        logit_opacities=rng.normal(size=n),
        sh_coeffs=rng.normal(size=(n, k, 3)),
        dog_index=np.array(dog_index, dtype=np.uint32),
        dog_logit_opacities=rng.normal(size=m),
        dog_log_scales=rng.normal(size=(m, 3)),
    )


def vertex_columns(splats: Splats) -> dict[str, np.ndarray]:
    """The columns of ``vertex`` by name."""
    columns = {name: splats.means[:, i] for i, name in enumerate("xyz")}
    columns |= {f"f_dc_{c}": splats.sh_coeffs[:, 0, c] for c in range(3)}
    n_per_channel = splats.sh_coeffs.shape[1] - 1
    for c in range(3):
        for j in range(n_per_channel):
            columns[f"f_rest_{c * n_per_channel + j}"] = splats.sh_coeffs[:, 1 + j, c]
    columns["opacity"] = splats.logit_opacities
    columns |= {f"scale_{i}": splats.log_scales[:, i] for i in range(3)}
    x, y, z, w = splats.quats.T
    return columns | {"rot_0": w, "rot_1": x, "rot_2": y, "rot_3": z}


def dog_columns(splats: Splats) -> dict[str, np.ndarray]:
    values = [splats.dog_logit_opacities, *splats.dog_log_scales.T]
    return dict(zip(DOG, values, strict=True))


def slope_columns(splats: Splats) -> dict[str, np.ndarray]:
    """The element ``slopes`` by column: axis by axis, three channels each."""
    values = {f"slope_{3 * axis + channel}": splats.color_slopes[:, axis, channel]
              for axis in range(3) for channel in range(3)}  # fmt: skip
    return {"index": splats.slope_index} | values


def curvature_columns(splats: Splats) -> dict[str, np.ndarray]:
    """The element ``curvatures`` by column."""
    return {"index": splats.curvature_index} | {f"curvature_{k}": splats.brightness_curvatures[:, k] for k in range(6)}


def cut_columns(splats: Splats, plane: RowGroup = CUTS) -> dict[str, np.ndarray]:
    """The element ``cuts``, or that of another plane, by column."""
    (name,) = plane.names
    return {"index": getattr(splats, plane.index)} | {f"cut_{k}": getattr(splats, name)[:, k] for k in range(3)}


def shift_columns(splats: Splats) -> dict[str, np.ndarray]:
    """The element ``shifts`` by column: the move along the first axis by the view along each, and so on; mean views."""
    values = {f"shift_{3 * move + view}": splats.view_shifts[:, move, view] for move in range(3) for view in range(3)}
    return {"index": splats.shift_index} | values | {f"view_{k}": splats.mean_views[:, k] for k in range(3)}


def to_bytes(elements, file_format="binary_little_endian", types=None) -> bytes:
    """A PLY from {element: {column: values}}; every column is float unless ``types`` says otherwise."""
    types = types or {}
    lines, body = ["ply", f"format {file_format} 1.0", "comment made by a test"], b""
    for element, columns in elements.items():
        lines.append(f"element {element} {len(next(iter(columns.values())))}")
        lines += [f"property {types.get(name, 'float')} {name}" for name in columns]
        order = ">" if file_format == "binary_big_endian" else "<"
        dtype = [(name, order + CODES[types.get(name, "float")]) for name in columns]
        rows = list(zip(*columns.values(), strict=True))
        if file_format == "ascii":
            body += "".join(" ".join(str(v) for v in row) + "\n" for row in rows).encode()
        else:
            body += np.array(rows, dtype=dtype).tobytes()
    return "\n".join([*lines, "end_header\n"]).encode() + body


def write(tmp_path, data: bytes) -> Path:
    path = tmp_path / "model.ply"
    path.write_bytes(data)
    return path

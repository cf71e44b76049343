"""Coloured point clouds: in which units files have their colours."""

import numpy as np
import pytest
from mi_dogsplat.datasets.point_ply import read_point_ply

COLORS = np.array([[0, 0.25, 1], [1, 0.5, 0.125]])


@pytest.mark.parametrize("layout", ["binary_little_endian", "ascii"])
@pytest.mark.parametrize(("kind", "code", "full"), [
    ("uchar", "u1", 255), ("ushort", "<u2", 255), ("ushort", "<u2", 65535), ("float", "<f4", 1), ("float", "<f4", 255),
])  # fmt: skip
def test_colours_come_as_shares_of_white_whatever_their_unit(tmp_path, layout, kind, code, full):
    header = f"ply\nformat {layout} 1.0\nelement vertex 2\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    header += "".join(f"property {kind} {channel}\n" for channel in ("red", "green", "blue")) + "end_header\n"
    rows = np.zeros(2, [("xyz", "<f4", 3), ("rgb", code, 3)])
    rows["xyz"], rows["rgb"] = [[1, 2, 3], [4, 5, 6]], COLORS * full
    lines = "".join(" ".join(map(str, [*row["xyz"], *row["rgb"]])) + "\n" for row in rows)
    (tmp_path / "points.ply").write_bytes(header.encode() + (lines.encode() if layout == "ascii" else rows.tobytes()))
    points, colors = read_point_ply(tmp_path / "points.ply")
    np.testing.assert_array_equal(points, rows["xyz"])
    np.testing.assert_allclose(colors, COLORS, atol=1 / 255)


@pytest.mark.parametrize(("kind", "values", "expected"), [
    ("uchar", (0, 1, 1), (0, 1 / 255, 1 / 255)), ("uchar", (0, 0.5, 1), (0, 0.5, 1)), ("float", (0, 1, 1), (0, 1, 1)),
])  # fmt: skip
def test_the_darkest_colours_of_ascii_files_are_dark_where_the_header_says_integers(tmp_path, kind, values, expected):
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    header += "".join(f"property {kind} {channel}\n" for channel in ("red", "green", "blue")) + "end_header\n"
    (tmp_path / "points.ply").write_text(header + " ".join(map(str, (1, 2, 3, *values))) + "\n")
    np.testing.assert_allclose(read_point_ply(tmp_path / "points.ply")[1][0], expected, rtol=1e-6)

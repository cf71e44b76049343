"""What the matches in a database say about a capture: databases whose pairs are made here."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mi_dogsplat.poses.evidence import FOCALS, Evidence, gather, translation_shares

pycolmap = pytest.importorskip("pycolmap", reason="needs pycolmap: pip install 'mi_dogsplat[poses]'")
SIZE, N_IMAGES = (640, 480), 4


@dataclass
class Pair:
    """Matches of two images from pixels to pixels, of which a rigid motion explains the first ones."""

    images: tuple[int, int]
    before: np.ndarray  # [M, 2]
    after: np.ndarray
    verified: int
    H: np.ndarray | None = None


def somewhere(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform([50, 50], [500, 400], (n, 2))


def moved(i: int, j: int, n: int, verified: int, by: float = 50.0) -> Pair:
    before = somewhere(n)
    return Pair((i, j), before, before + [by, 0], verified)


def evidence_of(file: Path, pairs: list[Pair]) -> Evidence:
    database = pycolmap.Database.open(str(file))
    database.write_camera(pycolmap.Camera.create_from_model_name(1, "PINHOLE", 500, *SIZE), use_camera_id=True)
    points: dict[int, list[np.ndarray]] = {number: [np.zeros((0, 2))] for number in range(1, N_IMAGES + 1)}
    for pair in pairs:
        matches = np.arange(len(pair.before)) + [[sum(map(len, points[image]))] for image in pair.images]
        for image, pixels in zip(pair.images, (pair.before, pair.after), strict=True):
            points[image].append(pixels)
        database.write_matches(*pair.images, matches.T.astype(np.uint32))
        geometry = pycolmap.TwoViewGeometry()
        geometry.inlier_matches = matches.T[: pair.verified].astype(np.uint32)
        if pair.H is not None:
            geometry.H = pair.H
        database.write_two_view_geometry(*pair.images, geometry)
    for number, pixels in points.items():
        database.write_image(pycolmap.Image(image_id=number, name=f"{number}.jpg", camera_id=1), use_image_id=True)
        database.write_keypoints(number, np.concatenate(pixels).astype(np.float32))
    database.close()
    return gather(pycolmap, file)


def test_features_and_matches_are_counted_by_image_and_shares_by_pairs_that_move(tmp_path):
    pairs = [moved(1, 2, 50, 40), moved(1, 3, 100, 90), moved(2, 3, 35, 35)]
    pairs += [moved(1, 4, 70, 29), moved(2, 4, 80, 40, by=11)]  # too few verified; hardly moved, in longest sides
    features, matches = (165 + 150) / 2, (90 + 40) / 2  # medians of 220, 165, 135, 150 and of 90, 40, 90, 40
    assert evidence_of(tmp_path / "a.db", pairs) == Evidence(features, matches, 3, explained=0.9, rotating=0, still=0)


def test_a_database_without_pairs_says_nothing_of_motion(tmp_path):
    assert evidence_of(tmp_path / "a.db", []) == Evidence(0, 0, 0, 0, 0, 0)


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


def lens(focal: float, width: int, height: int) -> np.ndarray:
    return np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])


def test_pairs_that_a_rotation_explains_are_a_share_of_all(tmp_path):
    K, pairs = lens(600, *SIZE), []
    plane = np.eye(3) - np.outer([0.2, 0, 0], [0, 0, 1])  # passed sideways
    for images, motion in zip(((1, 2), (1, 3), (1, 4)), (turn(0.1), turn(-0.2), plane), strict=True):
        H, before = K @ motion @ np.linalg.inv(K), somewhere(60)
        after = np.column_stack([before, np.ones(60)]) @ H.T
        pairs.append(Pair(images, before, after[:, :2] / after[:, 2:], 60, H))
    pairs.append(moved(2, 3, 60, 60))  # which no homography explains
    assert evidence_of(tmp_path / "a.db", pairs).rotating == 0.5


def test_a_rotation_between_images_of_two_sizes_is_one():
    sizes = [SIZE, (960, 1280)]
    H = lens(640, *sizes[1]) @ turn(0.1) @ np.linalg.inv(lens(320, *SIZE))
    assert translation_shares(H, sizes, 0.1)[0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("k", [0, -1])
def test_a_step_past_a_wall_is_nothing_but_translation(k):
    K = lens(float(FOCALS[k] * SIZE[0]), *SIZE)
    H = K @ (np.eye(3) - np.outer([0.1, 0, 0], [0, 0, 1])) @ np.linalg.inv(K)
    assert translation_shares(H, [SIZE, SIZE], float(0.1 * FOCALS[k]))[k] == pytest.approx(1, abs=0.1)


def by_depth(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of points at any depth, before and after a step to the side."""
    before, depth = somewhere(n, 1), np.random.default_rng(2).uniform(2, 6, (n, 1))
    return before, before + [300, 30] / depth


def by_chance(n: int) -> tuple[np.ndarray, np.ndarray]:
    return somewhere(n, 1), somewhere(n, 2)


@pytest.mark.parametrize("n_still, moving, verified, apart", [
    (40, by_depth(60), "moving", True), (40, by_depth(60), "still", True),
    (30, by_chance(32), "still", False),  # mistakes
    (30, by_depth(6), "still", False),  # too few for any motion
    (10, by_depth(90), "moving", False), (300, by_depth(40), "still", False),
])  # fmt: skip
def test_a_part_stands_still_where_another_moves_as_one(tmp_path, n_still, moving, verified, apart):
    still, (before, after) = somewhere(n_still), moving
    parts = [(still, still), (before, after)][:: -1 if verified == "moving" else 1]
    before, after = (np.concatenate(pixels) for pixels in zip(*parts, strict=True))
    found = evidence_of(tmp_path / "a.db", [Pair((1, 2), before, after, len(parts[0][0]))])
    assert found.n_pairs == (apart or verified == "moving") and found.still == apart

"""What features and matches say about a capture: the numbers that ``advice.py`` judges.

Pairs of images are looked at that have ``ENOUGH`` verified matches; those that hardly move say nothing about motion.

- **A rotation about the camera's centre** maps pixels by H = K R K⁻¹ (Hartley and Zisserman, 8.4), so that K⁻¹ H K has
  equal singular values. A translation t past a plane at distance d spreads them by about |t|/d, which also is how far
  the image moves over its focal length. So their spread over that motion is the share of translation in it: 0 for a
  rotation, 1 and more for a camera that is carried. K is not known here: the focal length counts by which most pairs
  rotate, one for all.
- **Something that stands still** in the image while the rest moves is no part of a rigid scene: the background of a
  turntable, a frame around the picture, a finger before the lens.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .colmap_database import opened

ENOUGH = 30  # verified matches
MOST_PAIRS = 400
MOVES = 0.02  # of the longest side: median motion of the matches of a pair that moves
STILL = 0.003  # of the longest side: a match that moves less stands still
PART = 0.15  # of the matches: what is no accident
CARRIED = 0.2  # share of translation in the motion above which a camera does not just turn
FOCALS = np.geomspace(0.5, 2, 33)  # in longest sides: what cameras have; so close that none is off by 3 %


@dataclass(frozen=True)
class Evidence:
    """``features``: median number over the images. ``matches``: the same of verified matches with the best partner.

    Over pairs, of which ``n_pairs`` move: ``explained``, median share of matches that one rigid motion explains;
    ``rotating``, share of pairs that a rotation explains; ``still``, share in which a part stands still. 0 without any.
    """

    features: float
    matches: float
    n_pairs: int
    explained: float
    rotating: float
    still: float


def gather(pycolmap: Any, database: Path) -> Evidence:
    """Read it from the database of a capture whose pairs are matched."""
    with opened(pycolmap, database) as content:
        images = {image.image_id: image for image in content.read_all_images()}
        cameras = {camera.camera_id: camera for camera in content.read_all_cameras()}
        features, best = [content.num_keypoints_for_image(image) for image in images], dict.fromkeys(images, 0)
        numbers, geometries = content.read_two_view_geometries()
        pairs = [pycolmap.pair_id_to_image_pair(number) for number in numbers]
        for ids, geometry in zip(pairs, geometries, strict=True):
            for image in ids:
                best[image] = max(best[image], len(geometry.inlier_matches))
        explained, rotating, still = [], [], []
        for (i, j), geometry in _some(pairs, geometries):
            size = max(cameras[images[i].camera_id].width, cameras[images[i].camera_id].height)
            raw = content.read_matches(i, j)  # [M, 2]
            a, b = content.read_keypoints(i)[:, :2], content.read_keypoints(j)[:, :2]
            verified = geometry.inlier_matches
            motion = np.linalg.norm(a[verified[:, 0]] - b[verified[:, 1]], axis=1) / size
            of_raw = np.linalg.norm(a[raw[:, 0]] - b[raw[:, 1]], axis=1) / size
            apart = _stands_apart(pycolmap, a[raw[:, 0]], b[raw[:, 1]], of_raw, motion)
            if apart or np.median(motion) > MOVES:
                still.append(apart)
                explained.append(len(verified) / len(raw))
                centers = [cameras[images[k].camera_id] for k in (i, j)]
                rotating.append(_rotates(geometry.H, centers, float(np.median(motion))))
    shares = [
        float(np.median(explained)) if explained else 0.0,
        float(np.mean(rotating, axis=0).max()) if rotating else 0.0,
        float(np.mean(still)) if still else 0.0,
    ]
    return Evidence(float(np.median(features)), float(np.median(list(best.values()))), len(still), *shares)


def _some(pairs: list[tuple[int, int]], geometries: list[Any]) -> Iterator[tuple[tuple[int, int], Any]]:
    """At most ``MOST_PAIRS`` of those that say something, evenly."""
    kept = [k for k, geometry in enumerate(geometries) if len(geometry.inlier_matches) >= ENOUGH]
    for k in kept[:: -(-len(kept) // MOST_PAIRS) or 1]:
        yield pairs[k], geometries[k]


def _rotates(H: np.ndarray | None, cameras: list[Any], motion: float) -> np.ndarray:
    """Whether the homography ``H`` [3, 3] of a pair, by which most matches move, is a rotation; bool by focal length.

    ``motion`` in longest sides; None stands for matches that no homography explains.
    """
    if H is None:
        return np.zeros(len(FOCALS), bool)
    return translation_shares(H, [(camera.width, camera.height) for camera in cameras], motion) < CARRIED


def translation_shares(H: np.ndarray, sizes: list[tuple[int, int]], motion: float) -> np.ndarray:
    """Spread of the singular values of K⁻¹ H K over the motion, [F] for each of ``FOCALS``: see the top of this file.

    Args:
        H: [3, 3] from pixels of the first image to those of the second.
        sizes: width and height of both.
        motion: of the matches, in longest sides.
    """
    shares = []
    for focal in FOCALS:
        K1, K2 = (np.array([[focal * max(w, h), 0, w / 2], [0, focal * max(w, h), h / 2], [0, 0, 1]]) for w, h in sizes)
        values = np.linalg.svd(np.linalg.solve(K2, H @ K1), compute_uv=False)
        shares.append((values[0] / max(values[2], 1e-12) - 1) / max(motion / focal, 1e-9))
    return np.array(shares)


def _stands_apart(pycolmap: Any, a: np.ndarray, b: np.ndarray, motion: np.ndarray, verified: np.ndarray) -> bool:
    """Whether a part of the matches ``a``, ``b`` [M, 2] stands still while another moves as one.

    ``motion`` [M] of these and ``verified`` of those that a rigid motion explains, in longest sides.
    """
    stands, moves = motion < STILL, motion > MOVES
    if stands.mean() < PART or moves.mean() < PART:
        return False
    if (verified > MOVES).mean() > PART:
        return True
    options = pycolmap.RANSACOptions(max_error=4.0, random_seed=0)  # the matches that move may be mere mistakes
    found = pycolmap.estimate_fundamental_matrix(a[moves], b[moves], options)
    return found is not None and found["num_inliers"] >= max(ENOUGH, 0.5 * moves.sum())

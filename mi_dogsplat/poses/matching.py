"""Which images see the same features: all pairs of a small set, of a large one those that may.

A video's frames are matched with the frames near them, with those 2, 4, 8, ... times as far, and with those that look
alike (a loop that closes). Photographs that are many are matched with those that look alike, and with those taken just
before and after.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..datasets.dataset import counted_order
from ..support.cores import usable_cores
from ..support.files import read_json, replacing, write_json
from .colmap_database import PAIR_BYTES, opened, require_room
from .config import PosesConfig
from .features import device
from .panoramas import panorama_of
from .retrieval import nearest, similarities

EXHAUSTIVE = 150  # images, up to which all pairs are tried
EXHAUSTIVE_VIDEO = 40
WINDOW = 10  # frames of a video, to either side
LOOPS = 5  # frames elsewhere that look most like a frame
ALIKE, BESIDE = 40, 3  # images of a large set: that look most like an image, and that stand beside it by name
BATCH = 25  # pairs per core between two reports
PAIRS, DONE = "pairs.txt", "pairs_done.json"


def pairs_of_video(similarity: np.ndarray) -> list[tuple[int, int]]:
    """Pairs (i, j) of frames, i < j, sorted; ``similarity`` [I, I] of ``retrieval.py``."""
    n = len(similarity)
    offsets = [*range(1, WINDOW + 1), *(2**k for k in range(4, n.bit_length()))]
    near = {(i, i + offset) for offset in offsets for i in range(n - offset)}
    return sorted(near | nearest(similarity, LOOPS, apart=WINDOW))


def pairs_of_many(similarity: np.ndarray) -> list[tuple[int, int]]:
    """Pairs (i, j) of photographs, i < j, sorted; ``similarity`` [I, I] of ``retrieval.py``."""
    n = len(similarity)
    beside = {(i, i + offset) for offset in range(1, BESIDE + 1) for i in range(n - offset)}
    return sorted(beside | nearest(similarity, ALIKE))


def match(
    pycolmap: Any, database: Path, video: bool, config: PosesConfig, progress: Callable[[int, int], None]
) -> None:
    """Match features and verify them by two-view geometry, from where an earlier call was stopped.

    Raises ``DataError`` for a disk that is full.
    """
    with opened(pycolmap, database) as content:
        images = sorted(content.read_all_images(), key=lambda image: counted_order(image.name))
        pairs = _pairs(content, images, video, config.seed)
    if config.panoramas:  # views of one place hold no depth
        pairs = [(i, j) for i, j in pairs if panorama_of(images[i].name) != panorama_of(images[j].name)]
    names, batch, counter = [image.name for image in images], BATCH * usable_cores(), database.with_name(DONE)
    done = int(read_json(counter, "remove the file")) if counter.is_file() else 0  # of pairs, which have their order
    options = pycolmap.FeatureMatchingOptions(num_threads=usable_cores(), use_gpu=config.gpu)
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = config.seed
    progress(done, len(pairs))
    for at in range(done, len(pairs), batch):
        require_room(database, len(pairs[at : at + batch]) * PAIR_BYTES)
        _match_pairs(pycolmap, database, names, pairs[at : at + batch], options, verification, config.gpu)
        write_json(counter, min(at + batch, len(pairs)))
        progress(min(at + batch, len(pairs)), len(pairs))


def _pairs(content: Any, images: Sequence[Any], video: bool, seed: int) -> list[tuple[int, int]]:
    n = len(images)
    if n <= (EXHAUSTIVE_VIDEO if video else EXHAUSTIVE):
        return [(i, j) for i in range(n) for j in range(i + 1, n)]
    similarity = similarities((content.read_descriptors(image.image_id).data for image in images), seed)
    return pairs_of_video(similarity) if video else pairs_of_many(similarity)


def _match_pairs(
    pycolmap: Any,
    database: Path,
    names: Sequence[str],
    pairs: Sequence[tuple[int, int]],
    options: Any,
    verification: Any,
    gpu: bool,
) -> None:
    listed = database.with_name(PAIRS)
    with replacing(listed) as part:
        part.write_text("".join(f"{names[i]} {names[j]}\n" for i, j in pairs), encoding="utf-8")
    pairing = pycolmap.ImportedPairingOptions(match_list_path=str(listed))
    try:
        pycolmap.match_image_pairs(str(database), options, pairing, verification, device(pycolmap, gpu))
    finally:
        listed.unlink()

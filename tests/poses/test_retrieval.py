"""Which images look alike, and whom they are matched with: by the formulas, written out in float64."""

import numpy as np
from mi_dogsplat.poses import retrieval
from mi_dogsplat.poses.matching import ALIKE, BESIDE, LOOPS, WINDOW, pairs_of_many, pairs_of_video
from mi_dogsplat.poses.retrieval import similarities


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def roots(descriptors: np.ndarray) -> np.ndarray:
    """RootSIFT, float64."""
    return np.array([unit(np.sqrt(d)) for d in descriptors.astype(np.float64)])


def nearest_word(root: np.ndarray, words: np.ndarray) -> int:
    return int(np.argmin([np.linalg.norm(root - word) for word in words]))


def vlad(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    sums = np.zeros(words.shape)
    for root in roots(descriptors):
        k = nearest_word(root, words)
        sums[k] += root - words[k]
    return unit(np.concatenate([unit(s) if s.any() else s for s in sums]))


def test_similarities_are_cosines_of_residuals_that_count_alike_at_every_word(monkeypatch):
    rng = np.random.default_rng(3)
    words = (0.6 * roots(rng.integers(1, 120, (5, 128)))).astype(np.float32)  # of different lengths, as means are
    words[3] *= 1.3
    monkeypatch.setattr(retrieval, "_words", lambda *_: words)
    monkeypatch.setattr(retrieval, "PER_IMAGE", 10)  # of all scales, evenly
    looked_at = range(0, 30, 3), range(7), range(1), range(10)
    images = [rng.integers(0, 120, (n, 128)) * (np.arange(128) % 4 != k) for k, n in enumerate((34, 7, 1, 12))]
    vectors = np.array([vlad(d[rows], words.astype(np.float64)) for d, rows in zip(images, looked_at, strict=True)])
    np.testing.assert_allclose(similarities(images, 0), vectors @ vectors.T, atol=1e-5)


def test_words_are_the_means_of_what_is_nearest_to_them(monkeypatch):
    rng = np.random.default_rng(4)
    monkeypatch.setattr(retrieval, "WORDS", 4)
    centres = rng.integers(0, 200, (4, 128))
    descriptors = np.concatenate([np.maximum(c + rng.integers(-9, 9, (20, 128)), 0) for c in centres])
    images, found = np.array_split(descriptors, 5), []
    of_images = retrieval._words
    monkeypatch.setattr(retrieval, "_words", lambda *arguments: found.append(of_images(*arguments)) or found[0])
    similarities(images, 0)
    (words,), all_roots = found, roots(descriptors)
    nearest = np.array([nearest_word(root, words) for root in all_roots])
    assert words.shape == (4, 128) and len(set(nearest)) > 1
    for k in set(nearest):
        np.testing.assert_allclose(words[k], all_roots[nearest == k].mean(axis=0), atol=1e-5)


def most_alike(similarity: np.ndarray, n: int, apart: int) -> set[tuple[int, int]]:
    pairs = set()
    for i in range(len(similarity)):
        others = sorted((j for j in range(len(similarity)) if abs(i - j) > apart), key=lambda j: -similarity[i, j])
        pairs |= {(min(i, j), max(i, j)) for j in others[:n]}
    return pairs


def test_frames_and_photographs_are_matched_with_whom_the_rules_name_and_nobody_else():
    n = 133
    similarity = np.random.default_rng(5).random((n, n))
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n)]
    near = {(i, j) for i, j in pairs if j - i <= WINDOW or j - i in (16, 32, 64, 128)}
    assert pairs_of_video(similarity) == sorted(near | most_alike(similarity, LOOPS, WINDOW))
    beside = {(i, j) for i, j in pairs if j - i <= BESIDE}
    assert pairs_of_many(similarity) == sorted(beside | most_alike(similarity, ALIKE, 0))

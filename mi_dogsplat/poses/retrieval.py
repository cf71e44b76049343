"""Which images look alike, without a vocabulary from elsewhere: VLAD (Jégou et al. 2010) over the images' own words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

WORDS = 64
SAMPLE = 40_000  # descriptors that the words are made from
PER_IMAGE = 2_000  # descriptors of an image that are looked at: those found at the largest scales come first
ROUNDS = 10  # of k-means


def similarities(descriptors: Iterable[np.ndarray], seed: int) -> np.ndarray:
    """Cosines float32 [I, I] between images, by their descriptors: [F, 128] for each, F may be 0.

    Those of one image after the other are taken, and of each but ``PER_IMAGE`` are kept, as they are: of thousands of
    photographs all would be tens of gigabytes.
    """
    thinned = [d[:: max(1, len(d) // PER_IMAGE)][:PER_IMAGE].copy() for d in descriptors]
    words = _words(thinned, np.random.default_rng(seed))  # [WORDS, 128]
    vectors = np.stack([_vlad(_root(d), words) for d in thinned])  # [I, WORDS * 128]
    return vectors @ vectors.T


def nearest(similarity: np.ndarray, n: int, apart: int = 0) -> set[tuple[int, int]]:
    """Pairs (i, j), i < j, of each image and those ``n`` most like it whose numbers differ by more than ``apart``."""
    pairs = set()
    for i, row in enumerate(similarity):
        others = [j for j in np.argsort(-row, kind="stable") if abs(i - j) > apart and i != j][:n]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in others}
    return pairs


def _root(descriptors: np.ndarray) -> np.ndarray:
    """RootSIFT (Arandjelović and Zisserman 2012), of length 1; float32 [F, 128]."""
    values = np.sqrt(descriptors.astype(np.float32))
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-6)


def _words(descriptors: Sequence[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Means [WORDS, 128] of clusters of all descriptors, by a sample of them."""
    ends = np.cumsum([len(d) for d in descriptors])
    if not ends[-1]:
        return np.zeros((1, 128), np.float32)
    chosen = rng.permutation(ends[-1])[:SAMPLE]
    images = np.searchsorted(ends, chosen, side="right")
    sample = _root(np.stack([descriptors[i][k - ends[i]] for i, k in zip(images, chosen, strict=True)]))
    words = sample[:WORDS]
    for _ in range(ROUNDS):
        nearest_word = _nearest_words(sample, words)  # [S]
        counts = np.bincount(nearest_word, minlength=len(words))
        sums = np.stack([np.bincount(nearest_word, column, len(words)) for column in sample.T], -1)
        words = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], words).astype(np.float32)
    return words


def _vlad(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Sums of the residuals at each word, each of length 1, and all of them together; float32 [WORDS * 128]."""
    nearest_word = _nearest_words(descriptors, words)
    residuals = np.zeros_like(words)
    np.add.at(residuals, nearest_word, descriptors - words[nearest_word])
    residuals /= np.maximum(np.linalg.norm(residuals, axis=1, keepdims=True), 1e-9)
    return (residuals / max(float(np.linalg.norm(residuals)), 1e-9)).ravel()


def _nearest_words(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """[F] which of the words [WORDS, 128] is nearest to each descriptor [F, 128]."""
    return (descriptors @ words.T - 0.5 * (words**2).sum(axis=1)).argmax(axis=1)

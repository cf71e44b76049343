"""Which images look alike, without a vocabulary from elsewhere: VLAD (Jégou et al. 2010) over the images' own words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

WORDS = 64
SAMPLE = 40_000  # descriptors that the words are made from
PER_IMAGE = 2_000  # descriptors of an image that are looked at: those found at the largest scales come first
ROUNDS = 10  # of k-means


def similarities(descriptors: Sequence[np.ndarray], seed: int) -> np.ndarray:
    """Cosines float32 [I, I] between images, by their descriptors: [F, 128] for each, F may be 0."""
    thinned = [_root(d[:: max(1, len(d) // PER_IMAGE)][:PER_IMAGE]) for d in descriptors]
    words = _words(thinned, np.random.default_rng(seed))  # [WORDS, 128]
    vectors = np.stack([_vlad(d, words) for d in thinned])  # [I, WORDS * 128]
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
    """Means [WORDS, 128] of clusters of all descriptors."""
    everything = np.concatenate(descriptors)
    if not len(everything):
        return np.zeros((1, 128), np.float32)
    sample = everything[rng.permutation(len(everything))[:SAMPLE]]
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

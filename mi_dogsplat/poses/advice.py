"""What is wrong with a capture, and what to do about it: a test each of its evidence, and of the model made of it."""

from __future__ import annotations

from dataclasses import dataclass

from .evidence import Evidence

FEW_FEATURES = 300  # of an image; a sharp photograph of a textured scene has thousands
FEW_MATCHES = 40  # with the image that fits best
ROTATING, STILL = 0.8, 0.5  # shares of pairs
EXPLAINED = 0.4  # share of matches
COMPLETE = 0.9  # share of images with a pose
LARGE_ERROR = 1.5  # pixels


@dataclass(frozen=True)
class Outcome:
    """Of the model that was kept: ``others`` are the sizes of those that it does not connect to; ``error`` in pixels of
    the images in which features were sought."""

    n_images: int
    n_registered: int
    others: tuple[int, ...]
    error: float


def advice(evidence: Evidence, outcome: Outcome) -> list[str]:
    """A sentence for each thing that is wrong: what it is, and what to do; the most likely cause first."""
    found = []
    if evidence.features < FEW_FEATURES:
        found.append(
            f"too few features ({evidence.features:.0f} in an image): surfaces without texture, or images that are "
            "blurred, dark or small; use sharp images at full size, more light, or put patterned things into the scene"
        )
    elif evidence.matches < FEW_MATCHES:
        found.append(
            f"images hardly overlap ({evidence.matches:.0f} common features with the best neighbour): take more, so "
            "that each shows two thirds of what the one before shows"
        )
    if evidence.n_pairs and evidence.rotating > ROTATING:
        found.append(
            f"the camera turns but is not carried ({evidence.rotating:.0%} of the pairs are explained by a rotation): "
            "no depth can be seen from one place; walk sideways or around the scene"
        )
    if evidence.n_pairs and evidence.still > STILL:
        found.append(
            f"a part of the image stands still while the rest moves ({evidence.still:.0%} of the pairs): the "
            "background of a turntable, or a frame; paint it black in --masks"
        )
    if evidence.n_pairs and evidence.explained < EXPLAINED:
        found.append(
            f"much of what is seen moves by itself (one motion explains {evidence.explained:.0%} of the matches): "
            "mask people, cars or water with --masks, or film when they are away"
        )
    if 0 < outcome.n_registered < COMPLETE * outcome.n_images:
        parts = f", the rest in groups of {', '.join(map(str, outcome.others))}" if outcome.others else ""
        found.append(
            f"only {outcome.n_registered} of {outcome.n_images} images have a pose{parts}: take more images between "
            "those that have one and those that do not, or leave these out"
        )
    if outcome.n_registered and outcome.error > LARGE_ERROR:
        found.append(
            f"the reprojection error is large ({outcome.error:.2f} px): the lens may be stronger than its model "
            "(try --lens OPENCV), frames may be blurred, or the camera's shutter rolls (move more slowly)"
        )
    return found

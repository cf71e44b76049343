"""What is wrong with a capture, and what to do about it: a test each of its evidence, and of the model made of it."""

from __future__ import annotations

from dataclasses import dataclass

from ..support.wording import counted
from .evidence import Evidence

FEW_FEATURES = 300  # of an image; a sharp photograph of a textured scene has thousands
FEW_MATCHES = 40  # with the image that fits best
ROTATING, STILL = 0.8, 0.5  # shares of pairs
EXPLAINED = 0.4  # share of matches
COMPLETE = 0.9  # share of images with a pose
LARGE_ERROR = 1.2  # pixels
NARROW, WIDE = 15, 110  # degrees along the longer side: beyond, few lenses that are no fisheyes are


TAKE_MORE = "take more images, so that each shows two thirds of what the one before shows"


@dataclass(frozen=True)
class Advice:
    """What is wrong, and what to do about it."""

    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.problem}; {self.remedy}"


@dataclass(frozen=True)
class Outcome:
    """Of the model that was kept: ``others`` are the numbers of images in those that it does not connect to; ``error``
    in pixels of the images in which features were sought; ``guessed``: fields of view in degrees, along the longer
    side, of cameras about whose focal length the files said nothing."""

    n_images: int
    n_registered: int
    others: tuple[int, ...]
    error: float
    guessed: tuple[float, ...] = ()


def hopeless(evidence: Evidence) -> bool:
    """Whether no model can come of it: nothing fits together, or nothing has a depth."""
    return evidence.matches < 1 or _turns_only(evidence)


def advice_on_capture(evidence: Evidence) -> list[Advice]:
    """What is wrong with a capture; the most likely cause first."""
    found = []
    if evidence.features < FEW_FEATURES:
        what = f"too few features ({evidence.features:.0f} in an image)"
        what += ": surfaces have no texture, or images are blurred, dark or small"
        found.append(Advice(what, "use sharp images at full size, more light, or put patterned things into the scene"))
    elif evidence.matches < FEW_MATCHES:
        shared = counted(round(evidence.matches), "feature")
        what = f"images hardly overlap ({shared} in common with the best neighbour)"
        found.append(Advice(what, TAKE_MORE))
    if _turns_only(evidence):
        what = f"the camera turns but is not carried (a rotation explains {evidence.rotating:.0%} of the pairs)"
        what += ": depth cannot be seen from one place"
        found.append(Advice(what, "walk sideways or around the scene"))
    if evidence.still > STILL:
        what = f"a part of the image stands still while the rest moves ({evidence.still:.0%} of the pairs)"
        what += ": the background of a turntable, or a frame"
        found.append(Advice(what, "paint it black in --masks"))
    if evidence.n_pairs and evidence.explained < EXPLAINED:
        what = f"much of what is seen moves by itself (one motion explains {evidence.explained:.0%} of the matches)"
        found.append(Advice(what, "mask people, cars or water with --masks, or come back when they are gone"))
    return found


def advice_on_model(outcome: Outcome) -> list[Advice]:
    """What is wrong with a model."""
    found = []
    if outcome.n_registered < COMPLETE * outcome.n_images:
        what = f"only {outcome.n_registered} of {outcome.n_images} images have a pose"
        if outcome.others:
            what += f", others form groups of {', '.join(map(str, outcome.others))}"
        found.append(Advice(what, "take more images between these and the others, or leave the others out"))
    if outcome.error > LARGE_ERROR:
        what = f"the reprojection error is large ({outcome.error:.2f} px): the lens model does not fit, "
        what += "images are blurred, or the shutter is a rolling one"
        found.append(Advice(what, "try --lens OPENCV, or move the camera more slowly"))
    if unlikely := [angle for angle in outcome.guessed if not NARROW < angle < WIDE]:
        what = f"a camera comes out {unlikely[0]:.0f}° wide, which is unlikely: its focal length could not be found"
        found.append(Advice(what, "take images from more sides, or images whose EXIF states the focal length"))
    return found


def _turns_only(evidence: Evidence) -> bool:
    return evidence.rotating > ROTATING

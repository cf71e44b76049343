"""Draws the textures of demo_truth.xml into demo_textures/: ``python scenes/demo_textures.py``.

The PNG files are committed; run this after changing a picture. Everything is drawn at SUPERSAMPLE times its
size and averaged, then reduced to few colours, which keeps all files together below 100 kB.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

OUT = Path(__file__).parent / "demo_textures"
SUPERSAMPLE = 4
INK, CREAM, TEAL, CORAL, MUSTARD, SKY = "#16213e", "#f6ecd9", "#1f7a7a", "#e2533a", "#f2a71b", "#8fc1d4"


def canvas(width: int, height: int, color: str) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    image = Image.new("RGB", (width * SUPERSAMPLE, height * SUPERSAMPLE), color)
    return image, ImageDraw.Draw(image)


def save(image: Image.Image, name: str, colors: int = 32) -> None:
    size = (image.width // SUPERSAMPLE, image.height // SUPERSAMPLE)
    small = image.resize(size, Image.Resampling.BOX).quantize(colors, dither=Image.Dither.NONE)
    small.save(OUT / name, optimize=True)


def write(draw: ImageDraw.ImageDraw, center: tuple[float, float], text: str, size: float, color: str) -> None:
    """Bold text around a centre; both in pixels of the finished texture."""
    font = ImageFont.load_default(size * SUPERSAMPLE)
    place = (center[0] * SUPERSAMPLE, center[1] * SUPERSAMPLE)
    draw.text(place, text, color, font, anchor="mm", stroke_width=size * SUPERSAMPLE / 40, stroke_fill=color)


def block(letter: str, color: str) -> None:
    """The face of a toy block: a letter in two frames."""
    image, draw = canvas(192, 192, CREAM)
    s = SUPERSAMPLE
    draw.rectangle([9 * s, 9 * s, 183 * s, 183 * s], color)
    draw.rectangle([19 * s, 19 * s, 173 * s, 173 * s], CREAM)
    draw.rectangle([24 * s, 24 * s, 168 * s, 168 * s], outline=color, width=2 * s)
    write(draw, (96, 96), letter, 132, color)
    save(image, f"block_{letter.lower()}.png", 16)


def table() -> None:
    """The table top in polar coordinates: u is the distance from the centre, v the angle."""
    length, depth = 1536, 384  # along the rim, and from the centre (top) to the rim (bottom)
    image, draw = canvas(length, depth, CREAM)
    angle = (np.arange(length * SUPERSAMPLE) + 0.5) / (length * SUPERSAMPLE)  # [A] turns
    radius = (np.arange(depth * SUPERSAMPLE)[:, None] + 0.5) / (depth * SUPERSAMPLE)  # [R, 1]

    def paint(mask: np.ndarray, color: str) -> None:
        pixels = np.where(np.broadcast_to(mask, (image.height, image.width)), 255, 0).astype(np.uint8)
        image.paste(color, mask=Image.fromarray(pixels))

    def wave(n: int, phase: float = 0) -> np.ndarray:
        return np.abs(((n * angle + phase) % 1) - 0.5) * 2  # [A] 1 at the start of each of n parts, 0 between

    paint(radius < 0.70, SKY)
    paint(radius < 0.30 + 0.34 * wave(12) ** 0.7, CREAM)
    paint(radius < 0.27 + 0.34 * wave(12) ** 0.7, TEAL)
    paint(radius < 0.16 + 0.34 * wave(12, 0.5) ** 0.8, CREAM)
    paint(radius < 0.13 + 0.34 * wave(12, 0.5) ** 0.8, MUSTARD)
    paint(radius < 0.22, CREAM)
    paint((radius < 0.20) & ((24 * angle) % 1 < 0.5), CORAL)
    paint((radius > 0.655) & (radius < 0.70), CREAM)
    paint((radius > 0.665) & (radius < 0.69) & ((120 * angle) % 1 < 0.5), INK)
    paint((radius > 0.70) & (radius < 0.895), INK)
    paint((radius > 0.905) & ((96 * angle + 2 * (radius > 0.95) * 0.25) % 1 < 0.5), CORAL)
    paint(radius > 0.99, INK)
    # Once around: the rim is longer than the texture, so the letters look as wide there as they are drawn.
    font = ImageFont.load_default(66 * SUPERSAMPLE)
    words = "DIFFERENCE OF GAUSSIANS  +  SPLATS IN MITSUBA 3  +  "
    _, top, right, bottom = font.getbbox(words, stroke_width=6)
    letters = Image.new("L", (int(right), int(bottom - top)))
    ImageDraw.Draw(letters).text((0, -top), words, 255, font, stroke_width=6)
    letters = letters.resize((image.width, letters.height))
    image.paste(CREAM, (0, int(0.7975 * image.height) - letters.height // 2), letters)
    save(image.transpose(Image.Transpose.TRANSPOSE), "table.png", 32)


def cup() -> None:
    """Chevrons around a pencil cup."""
    image, draw = canvas(384, 192, TEAL)
    s = SUPERSAMPLE
    for row, color in enumerate([CREAM, MUSTARD, CREAM, CORAL, CREAM]):
        points = [(x * 16 * s, (38 + row * 24 + 16 * (x % 2)) * s) for x in range(25)]
        draw.line(points, color, 9 * s)
    for y in (6, 178):
        draw.rectangle([0, y * s, image.width, (y + 7) * s], CREAM)
    save(image, "cup.png", 16)


def card() -> None:
    """A note with a heading, lines of small print and a plot of a Gaussian minus a narrower one."""
    image, draw = canvas(256, 352, CREAM)
    s = SUPERSAMPLE
    draw.rectangle([8 * s, 8 * s, 248 * s, 344 * s], outline=TEAL, width=3 * s)
    write(draw, (128, 44), "DoG", 52, CORAL)
    write(draw, (128, 86), "G(x) - f G(x / F)", 22, INK)
    x = np.linspace(-3, 3, 200)
    y = np.exp(-(x**2) / 2) - 0.9 * np.exp(-(x**2) / 0.4)
    draw.line([(28 * s, 196 * s), (228 * s, 196 * s)], INK, 2 * s)
    curve = [(int((128 + 33 * a) * s), int((196 - 120 * b) * s)) for a, b in zip(x, y, strict=True)]
    draw.line(curve, CORAL, 5 * s, joint="curve")
    widths = np.random.default_rng(1)
    for line in range(9):
        left = 26
        while left < 205:
            right = min(left + int(widths.integers(12, 40)), 230)
            draw.rectangle([left * s, (222 + 12 * line) * s, right * s, (227 + 12 * line) * s], INK)
            left = right + 7
    save(image, "card.png", 16)


def die() -> None:
    """Five pips."""
    image, draw = canvas(64, 64, CREAM)
    s = SUPERSAMPLE
    for x, y in [(16, 16), (48, 16), (32, 32), (16, 48), (48, 48)]:
        draw.ellipse([(x - 7) * s, (y - 7) * s, (x + 7) * s, (y + 7) * s], INK)
    save(image, "die.png", 8)


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    table()
    for letter, color in [("D", CORAL), ("O", TEAL), ("G", INK)]:
        block(letter, color)
    cup()
    card()
    die()

"""Is what the engine computes right, and what does each digit cost? The parts of ``dogsplat check``."""

UNUSED = ("linear", "white")  # of how a model is drawn: they change what a screen shows of the colours measured here
PARTS = ("work-precision", "stability", "training")

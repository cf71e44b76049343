"""Is what the engine computes right, and what does each digit cost? The parts of ``dogsplat check``."""

PARTS = ("work-precision", "stability", "training")

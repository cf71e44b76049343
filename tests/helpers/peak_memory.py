"""``python -m tests.helpers.peak_memory N WIDTH HEIGHT [MEMORY]``: train N primitives a little; prints what it took,
and what was foreseen without bands.

Random points and pictures, all SH degrees, a checkpoint. A process of its own: the peak is that of its whole life.
"""

import json
import sys
import tempfile
from pathlib import Path

import mi_dogsplat  # noqa: F401
import mitsuba as mi
import numpy as np
from mi_dogsplat.datasets import Dataset, View
from mi_dogsplat.datasets.camera_paths import look_at
from mi_dogsplat.engine.bands import LISTED, WALKED
from mi_dogsplat.runs.checkpoint import save_checkpoint
from mi_dogsplat.scene.cameras import Camera
from mi_dogsplat.support.memory import peak_memory_mb
from mi_dogsplat.training.config import TrainConfig

N, WIDTH, HEIGHT = (int(word) for word in sys.argv[1:4])
MEMORY = sys.argv[4] if len(sys.argv) > 4 else "64G"
mi.set_variant("llvm_ad_rgb")

from mi_dogsplat.training.train import Trainer  # noqa: E402

rng = np.random.default_rng(0)
views = []
for i, angle in enumerate(np.linspace(0, 2 * np.pi, 4, endpoint=False)):
    w2c = look_at(3 * np.array([np.cos(angle), np.sin(angle), 0.3]), np.zeros(3), "z")
    camera = Camera(w2c, 1.1 * WIDTH, 1.1 * WIDTH, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)
    views.append(View(str(i), camera, rng.random((HEIGHT, WIDTH, 3), np.float32)))
points, colors = rng.uniform(-1, 1, (N, 3)).astype(np.float32), rng.random((N, 3), np.float32)
dataset = Dataset(Path("random"), views, [], points, colors, False)
trainer = Trainer(TrainConfig("random", "3dgs", memory=MEMORY), dataset)
trainer.step_count = 4000  # from here on with all SH degrees
for _ in range(2):
    trainer.step()
budget = trainer.memory
assert budget
foreseen = budget.fixed + N * budget.each(0) + (LISTED + WALKED) * budget.pairs
in_bands = budget.for_pairs(trainer.optimizer) < (LISTED + WALKED) * budget.pairs
with tempfile.TemporaryDirectory() as folder:
    save_checkpoint(Path(folder) / "state.npz", trainer.state())
print(json.dumps({"foreseen_mb": foreseen / 1e6, "peak_mb": peak_memory_mb(), "pairs": budget.pairs,
                  "in_bands": in_bands}))  # fmt: skip

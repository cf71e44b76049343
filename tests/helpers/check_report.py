"""What ``dogsplat check`` reports, made up, and the figures of its page."""

import re


def row(group: str, setting: str, ms: float, error: float, **others) -> dict:
    return {
        "group": group, "setting": setting, "default": False, "forward_ms": ms, "total_ms": 3 * ms,
        "mean_error": error, "max_error": 9 * error, "psnr": 60.0, "rounding_error": 1e-7,
        "gradient_error": {"means": error, "quats": 2 * error}, "worst_gradient_error": 2 * error,
        "image_front": False, "gradient_front": False, **others,
    }  # fmt: skip


REPORT = {
    "model_name": "fox & friends.ply",
    "machine": {"variant": "llvm_ad_rgb", "cores": 2, "load": 0.1},
    "work_precision": [
        {
            "name": "a < b", "what": "few primitives", "width": 64, "height": 48, "n": 9, "n_dog": 0,
            "rows": [
                row("", "default", 5.0, 1e-3, default=True, image_front=True),
                row("", "no cutoffs", 9.0, 1e-7, image_front=True, gradient_front=True),
                row("alpha cutoff", "1/64", 4.0, 4e-3, image_front=True),
                row("alpha cutoff", "1/255", 5.0, 1e-3, default=True, image_front=True),
                row("bound", "16", 5.5, 2e-3, rounding_error=None),
                row("bound", "1", 5.0, 1e-3, default=True, image_front=True),
            ],
        }
    ],
    "training": [
        {"run": "a", "label": "fox · <3dgs>", "seconds": 100.0, "n": 3000, "final": {"psnr": 27.5, "flip": 0.1},
         "l1": [[1.0, 0.1], [99.0, 0.01]], "psnr": [[50.0, 25.0], [100.0, 27.5]], "flip": [[100.0, 0.1]]},
        {"run": "b", "label": "fox · ours", "seconds": 50.0, "n": 300, "final": {"psnr": 27.4},
         "l1": [[1.0, 0.2], [49.0, 0.02]], "psnr": [], "flip": []},
    ],
    "stability": [
        {"group": "shape", "name": "needle", "finite": True, "image_error": 3e-7, "gradient_error": {"means": 2e-6},
         "max_T": 1.0, "verdict": "right", "note": ""},
        {"group": "camera", "name": "lens", "finite": False, "image_error": None, "gradient_error": 0.5,
         "max_T": 1.0, "verdict": "wrong", "note": "a <defect>"},
    ],
}  # fmt: skip


def figures(html: str, name: str = "") -> list[str]:
    return re.findall(rf'<svg [^>]*role="img" aria-label="{name}[^>]*>.*?</svg>', html, re.DOTALL)

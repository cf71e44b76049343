"""Run benchmarks by name; all timings without arguments. Experiments take flags of their own: NAME --help."""

import argparse
import importlib
import sys

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi

NAMES = ("versus_volprim", "training_step", "lean")
EXPERIMENTS = (
    *("dog_start", "scaling", "dog_share", "floor", "ellipsoids", "derivatives", "loss", "stiffness"),
    *("poison", "widths", "popping", "curvature", "renderers", "device_memory", "launches", "warps"),
    *("scene_scale", "million", "mixed_sh", "rate_distortion", "simplify", "poses", "dogpath", "shade", "rays"),
    *("refine_poses", "hdr", "misfits", "up", "appearance", "stretched", "indoors", "mesh_shadows"),
    "splat_lamps", "slopes",
)

if sys.argv[1:] and sys.argv[1] in EXPERIMENTS:
    importlib.import_module(f"benchmarks.{sys.argv[1]}").main(sys.argv[2:])
    sys.exit()
parser = argparse.ArgumentParser(
    prog="python -m benchmarks", description=__doc__, epilog="experiments: " + ", ".join(EXPERIMENTS)
)
parser.add_argument("names", nargs="*", choices=[*NAMES, []], help="which (default: all)")
parser.add_argument("--variant", default="llvm_ad_rgb")
args = parser.parse_args()
mi.set_variant(args.variant)
for name in args.names or NAMES:
    print(f"# {name} ({args.variant})")
    importlib.import_module(f"benchmarks.{name}").main()

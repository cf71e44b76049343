"""Run benchmarks by name; all of them without arguments."""

import argparse
import importlib

import mi_dogsplat  # noqa: F401  (before mitsuba: chooses the LLVM)
import mitsuba as mi

NAMES = ("versus_volprim", "training_step")

parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
parser.add_argument("names", nargs="*", choices=[*NAMES, []], help="which (default: all)")
parser.add_argument("--variant", default="llvm_ad_rgb")
args = parser.parse_args()
mi.set_variant(args.variant)
for name in args.names or NAMES:
    print(f"# {name} ({args.variant})")
    importlib.import_module(f"benchmarks.{name}").main()

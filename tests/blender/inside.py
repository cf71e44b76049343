"""Lets Blender itself, rather than its Python module, run the checks.

    blender --background --factory-startup --python-exit-code 1 --python tests/blender/inside.py -- PYTEST_ARGUMENTS

The Python of that Blender needs pytest.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))  # Blender does not look at PYTHONPATH
sys.exit(pytest.main(sys.argv[sys.argv.index("--") + 1 :]))

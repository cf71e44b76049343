"""Renders of several threads, which take turns."""

from __future__ import annotations

import threading

ONE_AT_A_TIME = threading.RLock()
"""Held by a render. Where four threads rendered at once, each its own scene, one run in four ended in Dr.Jit with
"unknown variable", or stood still (Dr.Jit 1.5). Not in a file that is loaded anew with the variant."""

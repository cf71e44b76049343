"""Fog, smoke and other media, which light paths do not see."""

from __future__ import annotations

from typing import Any

import mitsuba as mi


def warn_of_media(name: str, scene: mi.Scene) -> None:
    """A warning of Mitsuba's logger, in the ``name`` of a plugin, where shapes, those of groups too, bound media or a
    sensor is in one."""
    parts: Any = mi.traverse(scene).hierarchy
    if any(isinstance(part, mi.Medium) for part in parts):
        log: Any = mi.Log
        remedy = "dogsplat, with volpath nested, shows those before surfaces"
        log(mi.LogLevel.Warn, f"{name}: light passes through fog and other media as through empty space; {remedy}")

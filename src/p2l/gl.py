"""The GL that `MUJOCO_GL` names: where it is not there, the variable goes, since simulating needs none.

MuJoCo loads the library while it is imported, and fails with it; so this runs before anything imports MuJoCo. Without
the variable nothing is loaded before something is to be drawn, and `evaluation.video.player` then tries what there is.
"""

from __future__ import annotations

import ctypes
import os

_LIBRARIES = {"egl": ("libEGL.so.1", "libEGL.so"), "osmesa": ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")}
CHOICE = os.environ.get("MUJOCO_GL", "").strip().lower()  # before robosuite, imported later, sets it


def forget_missing() -> None:
    """Take `MUJOCO_GL` out of the environment where it names a library that cannot be loaded."""
    names = _LIBRARIES.get(os.environ.get("MUJOCO_GL", "").strip().lower(), ())
    if names and not any(_loads(name) for name in names):
        del os.environ["MUJOCO_GL"]


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True

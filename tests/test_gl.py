"""Simulating needs no GL: none is loaded, and one that `MUJOCO_GL` names and that is not there does not matter."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from p2l import gl
from p2l.errors import ConfigError
from p2l.registry import Registry

ROOT = Path(__file__).resolve().parents[1]
MAPS = "print([line.split()[-1] for line in open('/proc/self/maps') if any(n in line for n in {names})])"


def python(code, **environment):
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="tells by Linux's list of loaded libraries")
def test_making_every_world_loads_no_gl():
    """`discover` died in containers without libGL, which OpenCV's usual build loads, which robosuite imports."""
    make = "from p2l.worlds.table import WORLDS\nfor name in WORLDS.names(): WORLDS.factory(name)\n"
    names = ("libGL.so", "libEGL.so", "libOSMesa.so")
    assert python(make + MAPS.format(names=names), MUJOCO_GL="") == "[]"


@pytest.mark.parametrize("name", ["osmesa", "egl", "OSMesa", ""])
def test_mujoco_is_imported_whatever_the_shell_profile_says(name):
    """It failed in every stage that imports a world where `MUJOCO_GL=osmesa` was set and OSMesa was missing."""
    assert python("import p2l, mujoco; print(mujoco.__name__)", MUJOCO_GL=name) == "mujoco"


@pytest.mark.parametrize(("name", "left"), [("osmesa", None), ("egl", None), ("glfw", "glfw"), ("disable", "disable")])
def test_only_a_library_that_cannot_be_loaded_is_forgotten(monkeypatch, name, left):
    monkeypatch.setenv("MUJOCO_GL", name)
    monkeypatch.setattr(gl, "_LIBRARIES", {"egl": ("libnowhere.so.1",), "osmesa": ("libnowhere.so.2",)})
    gl.forget_missing()
    assert os.environ.get("MUJOCO_GL") == left
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(gl, "_LIBRARIES", {"egl": ("libnowhere.so.1", "libm.so.6")})
    gl.forget_missing()
    assert os.environ["MUJOCO_GL"] == "egl"


def test_without_a_screens_library_the_message_says_what_to_install():
    def load():
        raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")

    registry = Registry("world", {"ours": load})
    with pytest.raises(ConfigError, match=r"world 'ours': libGL\.so\.1.*opencv-python-headless.*libgl1"):
        registry.factory("ours")


def test_the_lock_has_the_opencv_that_needs_no_screen():
    lock = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    assert [line.partition("==")[0] for line in lock if line.startswith("opencv")] == ["opencv-python-headless"]

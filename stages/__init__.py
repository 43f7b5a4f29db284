"""Stages: load, call `p2l`, save. The only code that sees Hydra and tracking.

A checkout runs its own `p2l`, whichever one the environment has installed: DVC watches these files, so these are the
ones that must run.
"""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

if (_SOURCE := str(ROOT / "src")) not in sys.path:
    sys.path.insert(0, _SOURCE)

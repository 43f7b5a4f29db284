"""The picture of the rooms is that of the code."""

import io

import numpy as np
from PIL import Image

from scripts.draw_layers import PICTURE, arrows, draw, layers


def test_the_picture_shows_the_imports_of_today():
    drawn, kept = (np.asarray(Image.open(source).convert("L"), dtype=int) for source in (io.BytesIO(draw()), PICTURE))
    assert drawn.shape == kept.shape
    changed = (np.abs(drawn - kept) > 64).sum()  # an arrow is some hundred pixels; letters may be rounded otherwise
    assert changed < 60, "run `python scripts/draw_layers.py` and look at docs/layers.png"


def test_arrows_lead_down_only():
    level = {room: number for number, rooms in enumerate(layers()) for room in rooms}
    imports = arrows(set(level)).edges
    assert len(imports) > 20
    assert all(level[importer] < level[imported] for importer, imported in imports)

"""Lego stacking: parts of different sizes at different places (thesis, section 3.5.2)."""

"""A box from the table onto a shelf, with and without clutter (thesis, sections 5.4.2 and 5.4.3)."""

"""Insertion of pegs among walls, and the board of holes (thesis, section 3.5.1)."""

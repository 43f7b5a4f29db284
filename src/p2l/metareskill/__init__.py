"""Meta-reasoning for skill learning: which recovery to train next (thesis, sections 4.2.1 and 4.3.2 to 4.3.5).

Axis letters of this room: K nominal skills, M = K + 1 targets (a precondition each, the goal last), I failure modes,
T rounds of training, W the window of the rate of improvement.
"""

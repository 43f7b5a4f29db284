"""Meta-reasoning for skill learning: which recovery to train next (thesis, sections 4.2.1 and 4.3.2 to 4.3.5).

From the outside in: `failure_rounds.iteration` learns on from the failures that are left; `chooser_run` is Algorithm 3
for one seed and one chooser, on the `setting` that all of them share; `algorithm` chooses, trains, measures and writes
down; `choosers` decide; `trainer` trains one recovery once more, and asks a `query` of REPS to do it.

Axis letters of this room: K nominal skills, M = K + 1 targets (a precondition each, the goal last), I failure modes,
T rounds of training, W the window of the rate of improvement.
"""

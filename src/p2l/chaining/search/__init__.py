"""A learner that plans: macros are tried on failures, a model says which one where, a network learns it.

A macro is a few primitives, then a terminal option. Nearly every failure can be recovered from by one of a dozen
macros, and a simulator that restores any failure can try them one by one; so what a policy gradient has to meet by
chance is looked for, and every outcome is kept.
"""

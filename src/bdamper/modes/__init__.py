"""Nonlinear modes: frequency and damping over the amplitude of a free vibration, and what follows from them.

In: a :class:`bdamper.problem.problem.Problem`, a preload, a mode and an interval of amplitudes.  Out: the branch of its
periodic motions with all folds (`mode`), and the limit cycles at which friction balances a flow that excites (`flutter`).
Branches are followed by the means of `continuation`.
"""

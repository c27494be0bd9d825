"""A problem: one model under one set of settings, and the equations that follow from them.

In come a model and settings, checked at once; out come bases of the harmonics, contact stiffness, static states under the
preload and ``system(preload)``, the equations of the harmonic balance, all made once and kept.  Others use
:class:`~bdamper.problem.problem.Problem`, :class:`~bdamper.problem.effects.Effects` (the physical effects that are
included) and :func:`~bdamper.problem.variation.vary` (a problem with settings changed by name).
"""

"""Harmonic balance: the equations of one preload, evaluated and solved by the C core.

In come bases of the harmonics, contact points and loads; out come residual, Jacobian, Newton corrections and linear
responses.  Others use :class:`~bdamper.harmonic_balance.equations.Equations`, the only access to the core, and the linear
resonances of :mod:`bdamper.harmonic_balance.linear`.
"""

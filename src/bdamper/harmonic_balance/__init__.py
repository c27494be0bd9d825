"""Harmonic balance: the equations of one preload, evaluated and solved by the C core.

The equations (paper, Eq. (16)) are evaluated in ``csrc/bd_hbm.c``: for the modal amplitudes ``q_l`` of each harmonic,

    r_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l - E_l,

with the Fourier coefficients ``F_l`` of the contact forces (Eq. (15)) from ``csrc/bd_element.c``, and the friction model of
the paper from ``csrc/bd_event.c``.

In come bases of the harmonics, contact points and loads; out come residual, Jacobian, Newton corrections and linear
responses.  Others use :class:`~bdamper.harmonic_balance.equations.Equations`, the only access to the core, and the linear
resonances of :mod:`bdamper.harmonic_balance.linear`.
"""

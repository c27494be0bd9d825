"""A study's settings and problem, and the harmonic balance equations that the C core evaluates.

The equations (paper, Eq. (16)) are evaluated in ``csrc/balance/harmonic_balance.c``: for the modal amplitudes ``q_l`` of
each harmonic,

    r_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l - E_l,

with the Fourier coefficients ``F_l`` of the contact forces (Eq. (15)) from ``csrc/contact/element.c`` and
``csrc/contact/event_driven.c``.

`Settings` are checked settings, `Problem` derives bases, contact stiffness and static states from them, and
``Problem.system(preload)`` returns the `Equations` that evaluate residual and Jacobian and run Newton corrections.
"""

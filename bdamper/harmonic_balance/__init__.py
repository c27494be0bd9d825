"""Settings of a study, the problem that follows from them, and the harmonic balance equations
(paper, Eq. (16)).

`Settings` are checked settings.  `Problem` derives bases, contact stiffness and static states from
them.  ``Problem.system(preload)`` returns `Equations`, which evaluate residual and Jacobian and run
Newton iterations.  The mathematics is in :mod:`bdamper.harmonic_balance.equations`;
``csrc/balance/harmonic_balance.c`` evaluates it.
"""

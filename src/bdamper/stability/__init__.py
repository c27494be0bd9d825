"""Stability of periodic solutions, and time integration of the same equations.

In come a problem and a tracking curve; out come the curve with a verdict for each point, the comparison of one point with
a march in time, and the response that a march settles to.  Others use :func:`~bdamper.stability.floquet.with_stability`,
:func:`~bdamper.stability.settled.verify` and :func:`~bdamper.stability.settled.settle`.
"""

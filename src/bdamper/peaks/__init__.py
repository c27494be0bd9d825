"""Resonance peaks: finding one, its sensitivities, the highest point of a curve, and of whole curves over the preload.

In come a problem or its equations as a function of one parameter; out come peaks and the optimal curve with its optimum.
Others use :func:`~bdamper.peaks.newton.find_peak`, :func:`~bdamper.peaks.sensitivity.sensitivities`,
:func:`~bdamper.peaks.highest.highest_of_curve`, :func:`~bdamper.peaks.highest.highest_peak` and
:func:`~bdamper.peaks.optimal.optimal_curve`.
"""

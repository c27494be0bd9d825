"""Resonance peaks: finding one, its sensitivities, following it over a parameter, all of them over the preload.

In come a problem or its equations as a function of one parameter; out come peaks and the optimal curve with its optimum.
Others use :func:`~bdamper.peaks.newton.find_peak`, :func:`~bdamper.peaks.sensitivity.sensitivities`,
:class:`~bdamper.peaks.follower.PeakFollower`, :func:`~bdamper.peaks.highest.highest_peak` and
:func:`~bdamper.peaks.optimal.optimal_curve`.
"""

"""Design: sweeps over settings, optimal curves of uncertain settings, sensitivities of a peak to settings.

In come a problem and values, or distributions, of settings that are changed by name; out come results over these settings.
Others use :func:`~bdamper.design.sweep.sweep` with its questions ``PeakTask`` and ``OptimalTask``,
:func:`~bdamper.design.uncertainty.uncertain_curve`, :func:`~bdamper.design.uncertainty.robust_optimum` and
:func:`~bdamper.design.sensitivity.peak_sensitivities`.
"""

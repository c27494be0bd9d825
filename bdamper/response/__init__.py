"""Forced response: response curves through folds, resonance peaks, and the optimal preload.

`response_curve` computes a response curve at one preload; `branches` finds its first point and
covers the frequency interval, `continuation` follows one path, `events` locates folds and maxima.
`peak` solves for one resonance peak, `highest_peak` selects the highest one.  `optimal_curve`
computes the peak as a function of the preload; `scalar_search` chooses the optimum.  `sensitivity`
differentiates peaks and curves.  `verification` defines the results of checks in time, with more
harmonics and by error estimates.
"""

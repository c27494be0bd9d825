"""Forced response: response curves through folds, resonance peaks, and peaks over the preload.

`response_curve` computes a response curve at one preload: `initial_solution` finds a first point, `continuation` follows
the path from it, and `branches` collects paths until they span the interval.  `peak` finds and refines one resonance peak,
`highest_peak` the highest one, `optimal_curve` the peak over the preload with its minimum, `sensitivity` their derivatives.
`linear_curve` computes the responses with free and with stuck contacts.
"""

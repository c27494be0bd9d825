"""How accurate an answer is, and what accuracy costs.

In come a problem and a question (a curve, a peak, an optimal curve); out come answers with the harmonics that a tolerance
needs (``tolerance``: ``track_to_tolerance``, ``peak_to_tolerance``, ``optimal_curve_to_tolerance``), errors of a peak by
source (``estimate``: ``estimate_errors``, ``with_errors``), and errors beside times for ladders of settings (``ladders``:
``accuracy_cost``; ``ways``: how the peak is found).
"""

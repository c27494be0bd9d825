"""How accurate an answer is, and what accuracy costs.

In come a problem and a question (a curve, a peak, an optimal curve); out come answers with what more harmonics change of
them (``tolerance``: ``track_to_tolerance``, ``peak_to_tolerance``, ``with_ladder``), errors of a peak by source
(``estimate``: ``estimate_errors``, ``with_errors``), and errors beside times for ladders of settings (``ladders``:
``accuracy_cost``).
"""

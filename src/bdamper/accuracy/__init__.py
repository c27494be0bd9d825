"""How accurate an answer is, and what accuracy costs.

In come a problem and a result (a curve, a peak, an optimal curve); out come a peak with more harmonics (``converge``:
``converge``, ``at_optimum``), errors of a peak by source
(``estimate``: ``estimate_errors``, ``with_errors``), and errors beside times for ladders of settings (``ladders``:
``accuracy_cost``).
"""

"""Friction oscillators beside a published package: the same equations and tolerance, first the answer, then the time."""

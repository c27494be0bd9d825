"""Continuation: the start of a response curve, its branches through folds, the curve as a result."""

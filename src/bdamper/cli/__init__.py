"""The command ``bdamper``: what a study answers, from a terminal.

In: a model file or ``--demo``, and settings with their units.  Out: what the result prints on the standard output, files of
it if they are asked for, progress and errors on the standard error, and 0, 1 (no answer: why) or 2 (wrong use).
"""

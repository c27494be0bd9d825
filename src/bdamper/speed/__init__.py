"""Analyses over rotor speed: Campbell and interference diagrams, crossings with engine orders, run-up along one of them.

In: a problem whose model knows its bases over speed, and speeds in rad/s.  Out: results with frequencies in Hz.  A family
of problems over speed (`family`) is what all of them ask; the response along the line of an engine order (`line`) is
followed by the means of `continuation`, its highest point refined by those of `peaks`.
"""

"""Time integration of the equations of motion, and stability of periodic solutions.

`integration` integrates all sectors with the contact laws of the C core.  `transient` integrates
period by period and decides whether a motion is steady.  `steady_amplitude` searches for the
highest steady amplitude near a resonance, and `time_response` states it with its error, at one
preload or along an optimal curve.  `frequency_sweep` changes the excitation frequency slowly in
time.  `floquet` determines the stability of the points of a response curve.
"""

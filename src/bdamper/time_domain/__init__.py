"""Time integration of the equations of motion, and stability of periodic solutions.

`integration` integrates all sectors with the contact laws of the C core.  `time_response` and `steady_amplitude` find the
steady amplitude near a resonance, `settling` integrates from one solution, `frequency_sweep` sweeps the excitation
frequency slowly. `floquet` and `wave_exponents` determine the stability of points of a response curve.
"""

"""Time integration of the equations of motion, and stability of periodic solutions.

`integration` integrates all sectors with the contact laws of the C core.  `march` integrates period by period and decides
whether a motion keeps an amplitude.  `transients` integrates from one solution, and sweeps the excitation frequency slowly.
`steady_amplitude` finds the steady amplitude near a resonance, `optimum_in_time` at preloads of an optimal curve.
`floquet` determines the stability of the points of a response curve.
"""

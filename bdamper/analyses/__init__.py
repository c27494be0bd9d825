"""Analyses that solve a problem many times: sweeps, uncertainty, accuracy, fits, nonlinear modes, rotor speed.

`sweep` varies settings on any executor. `optimal_curve_uncertainty` samples them. `fit` and
`fit_loop` identify contact parameters from measurements. `harmonic_convergence`, `estimate_errors`,
`effect_significance` and `accuracy_cost` compare a study with more detailed ones. `nonlinear_mode`
and `flutter` compute modes and limit cycles. `campbell`, `crossings` and `run_up` compute responses
against rotor speed. `hysteresis` and `microslip` compute contact loops.
"""

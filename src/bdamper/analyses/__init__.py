"""Analyses that solve a problem many times: sweeps, uncertainty, accuracy, fits, nonlinear modes, rotor speed.

`sweep` varies settings on any executor, `uncertainty` samples them, `fit` and `loop_fit` identify contact parameters from
measurements.  `harmonic_convergence`, `error_estimates`, `effect_selection` and `accuracy_cost` compare a study with more
detailed ones.  `nonlinear_mode` and `flutter` compute modes and limit cycles, `campbell`, `crossings` and `run_up`
responses over rotor speed, `hysteresis` and `microslip` contact loops.
"""

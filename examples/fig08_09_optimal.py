r"""
Optimal and frequency-shift curves of the first two blade modes (Figs 8 and 9)
==============================================================================

Highest resonance amplitude and its frequency against preload, with the preload of lowest amplitude.

===========================  =======  =====================  ===========
\                            paper    settings of the paper  converged
===========================  =======  =====================  ===========
mode 1, stuck over optimum   4.4      4.2                    15.0
mode 2, stuck over optimum   5.5      5.7                    5.2
mode 1, frequency shift      17.2 %   17.3 %                 18.2 %
mode 2, frequency shift      3.4 %    3.4 %                  2.5 %
===========================  =======  =====================  ===========

* The model was designed to reproduce these four numbers with the settings of the paper. The
  converged results retain the ratio of mode 2 and the shift of mode 1, but not the other two
  numbers.
* The statement that damping, measured by the ratio of stuck to optimum amplitude, is more effective
  in mode 2 holds only with the approximations of the paper.
* The statement that the reduction from the free amplitude is larger in mode 1 does not hold as a
  ratio with the approximations of the paper (4.5 and 5.6), but holds for the converged results (16
  and 5.1).

A damper that only slips as a whole, with the stiffness kd in parallel with k and under constant
normal load, reaches an amplitude of pi F/kd at best. The ratio of the stuck amplitude F/(2 zeta (k
+ kd)) to this amplitude is

.. math:: \frac{1 - (f_{free}/f_{stuck})^2}{2 \pi \zeta},

printed as "macroslip". It is not a bound if the normal load varies: mode 2 exceeds it.
"""

import numpy as np
from paper_disk import DAMPING_RATIO, MODES, keep, plot_optimal_beside, stored, study

import bdamper as bd
from bdamper.response.optimal_curve_result import OptimalCurve

PUBLISHED = {1: (4.4, 17.2), 2: (5.5, 3.4)}
"""Ratio and shift (%) in the paper."""
paper, converged = {}, {}


def macroslip_ratio(curve: OptimalCurve) -> float:
    """Return the ratio of stuck to optimum amplitude for a damper that only slips as a whole, under
    constant normal load.
    """
    return (1.0 - (curve.free.frequency / curve.stuck.frequency) ** 2) / (
        2.0 * np.pi * DAMPING_RATIO
    )


def optimal(mode: int) -> None:
    """Compute the optimal curve with the settings of the paper, load the stored converged curve,
    and draw and print both.
    """
    driven = MODES[mode]
    paper[mode] = study(mode, **bd.CIGEROGLU_2009).optimal_curve(
        driven.interval, 24, frequency=driven.band, check=False
    )
    converged[mode] = stored(f"optimal_{mode}")
    print(f"the paper: ratio {PUBLISHED[mode][0]}, shift {PUBLISHED[mode][1]} %")
    for name, curve in (("settings of the paper", paper[mode]), ("converged", converged[mode])):
        o = curve.optimum
        print(
            f"{name}: {1e3 * o.amplitude:.5f} mm at {o.preload:.0f} N, ratio {curve.ratio:.1f} (macroslip "
            f"{macroslip_ratio(curve):.1f}), free over optimum {curve.free.amplitude / o.amplitude:.1f}, shift "
            f"{curve.stuck_shift_percent:.1f} %"
        )
    keep(
        plot_optimal_beside(paper[mode], converged[mode], f"Mode {mode}"),
        f"fig0{7 + mode}_optimal_mode_{mode}",
    )


# %%
# **Fig. 8.** The converged optimum of mode 1 is the least value found, not a verified one: below 92 N no steady response
# is expected.  It is not converged in harmonics: at 135 N nine give a fifth more than three.

optimal(1)

# %%
# **Fig. 9.** In mode 2 both optima are verified.

optimal(2)

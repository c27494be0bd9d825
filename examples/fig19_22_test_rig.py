"""
A test rig with one blade and two dampers (Figs 19 to 22)
=========================================================

One test blade stands between two dummy blades without airfoil; two wedge dampers are pulled against
the platforms by equal loads.  The three blades are one acyclic structure, so the interblade phase
angle is zero.  In the paper, this blade also differs from the blade of the disk. Its measured
points are published only in figures, not as numbers, and are not shown here.
"""

import matplotlib.pyplot as plt
import numpy as np
from paper_disk import RIG_BAND, RIG_LOADS, RIG_PLAIN, keep, rig_study, stored

import bdamper as bd
from bdamper.plot.axes import STYLE, looks
from bdamper.response.optimal_curve_result import OptimalCurve

# %%
# **Fig. 19.** The blades, the dampers and their loads, seen along the axis.

model = bd.reference_model("test_rig")
with plt.rc_context(STYLE):
    figure, ax = plt.subplots(figsize=(5.6, 4.4))
platform = 1e3 * model.locations["platform"].position[1]
for body, mesh in model.meshes.items():
    depth = mesh.points[mesh.quads, 2]
    front = mesh.quads[(np.ptp(depth, axis=1) < 1e-4) & (depth.mean(axis=1) > 0.0)]
    front = front[1e3 * mesh.points[front, 1].max(axis=1) < platform + 1.0]  # without the airfoil
    shade = "0.72" if body.startswith("damper") else "0.88"
    for quad in front:
        ax.fill(*1e3 * mesh.points[quad, :2].T, facecolor=shade, edgecolor="0.5", linewidth=0.3)
for name, body in model.bodies.items():
    if body.load is not None:
        place, along = 1e3 * body.centre[:2], body.load.direction[:2]
        ax.annotate(
            "", place + 28.0 * along, place, arrowprops={"arrowstyle": "-|>", "linewidth": 1.4}
        )
        side = -1.0 if name.endswith("left") else 1.0
        ax.text(
            *(place + 30.0 * along + [2.0 * side, 0.0]),
            "load of\nthe damper",
            ha="center",
            va="bottom",
            fontsize=7.5,
        )
for x, text in ((0.0, "test blade\n(airfoil above)"), (-42.0, "dummy"), (42.0, "dummy")):
    ax.text(x, platform + 2.0, text, ha="center", va="bottom", fontsize=7.5)
ax.set(aspect="equal", xlabel="X (mm)", ylabel="Y (mm)", ylim=(platform - 60.0, platform + 36.0))
ax.grid(False)
keep(figure, "fig19_test_rig")

# %%
# **Fig. 20.** The model.

keep(model.plot(), "fig20_test_rig")

# %%
# **Figs 21 and 22.** Frequency shift and normalised optimal curve.
#
# * The frequency rises and the amplitude passes a minimum: holds.
# * Complete locking is not reached and microslip remains at high load: holds.  At a hundred times the optimum load, where
#   every point of a bladed disk sticks, the rig still slips.  In the disk the neighbour moves along with a small phase,
#   here it stands still, so the damper bears the whole motion of the blade.
# * A prediction with more blade modes, for which the contact stiffness is computed anew, is close: holds from 10 to 20
#   modes (less than 1 %) and does not hold beyond: with 40 the optimum is a third lower.  Agreement of two was no
#   convergence.
# * Converged, no steady response is expected below 2.4 kN, where the optimum with one harmonic lies: there is no optimum
#   load to draw that curve over.


def at_normalised_load(curve: OptimalCurve, load: float) -> tuple[float, float]:
    """Return the ratio of the amplitude to the stuck amplitude, and the fraction of slip, at a
    multiple of the optimal load.
    """
    k = int(np.argmin(np.abs(np.log(curve.preload / curve.optimum.preload / load))))
    return float(curve.amplitude[k] / curve.stuck.amplitude), float(curve.shares[k, 1])


curves = {
    f"{n} modes": rig_study(**RIG_PLAIN, blade_modes=n).optimal_curve(
        RIG_LOADS, 30, frequency=RIG_BAND, check=False
    )
    for n in (10, 20)
}
curves["40 modes"] = stored("optimal_rig_40_modes")
curves["converged"] = stored("optimal_rig")
disk = bd.reference_model("bladed_disk", contact_points=24)
wheel = bd.Study(
    disk,
    bd.Excitation("tip"),
    engine_order=5,
    friction_coefficient=0.4,
    blade_modes=10,
    **RIG_PLAIN,
)
curves["bladed disk"] = wheel.optimal_curve(
    (60.0, 1.5e5), 30, frequency=(270.0, 380.0), check=False
)
for name, curve in curves.items():
    ratio, slip = at_normalised_load(curve, 100.0)
    what = "optimum" if curve.optimum.ok else "least, not verified,"
    print(
        f"{name:14} {what} {1e3 * curve.optimum.amplitude:.4f} mm at {curve.optimum.preload:6.1f} N, shift "
        f"{curve.stuck_shift_percent:.1f} %; at 100 times that load: {ratio:.2f} of the stuck amplitude, slip "
        f"{100 * slip:.1f} %"
    )
shown = {name: curve for name, curve in curves.items() if curve.optimum.ok}
with plt.rc_context(STYLE):
    axes = [plt.subplots(figsize=(5.6, 3.6))[1] for _ in range(2)]
    for (name, curve), look in zip(shown.items(), looks(len(shown))):
        look["marker"] = ""
        load = curve.preload / curve.optimum.preload
        axes[0].plot(load, curve.shift_percent, label=name, **look)
        axes[1].plot(load, curve.amplitude / curve.free.amplitude, label=name, **look)
    for ax, label in zip(axes, ("Frequency shift (%)", "Resonance amplitude over free")):
        ax.set(xscale="log", xlabel="Load over optimum load", ylabel=label)
        ax.legend()
axes[1].set_yscale("log")
keep(axes[0], "fig21_frequency_shift")
keep(axes[1], "fig22_normalised_optimal_curve")

"""Pictures of every result; the only room that imports matplotlib and pyvista.

In: results, models and problems.  Out: matplotlib axes and figures, pictures and animations in files; motions and contact
states of solutions in plain arrays (:mod:`bdamper.plot.motion`), files for ParaView (:mod:`bdamper.plot.vtu`).  A
function that draws a type of result enters itself for it in :mod:`bdamper.util.plotting`, where ``result.plot()`` finds
it.  `new_axes` and `save_figure` begin and end a picture of several results.
"""

from bdamper.plot.axes import colours, new_axes, save_figure
from bdamper.plot.contact import (
    animate_damper,
    damper_picture,
    plot_contact_map,
    plot_peak,
    plot_static,
    plot_status_bars,
    plot_status_map,
    plot_stiffness,
)
from bdamper.plot.curves import (
    mark_kept,
    mark_settled,
    plot_curve,
    plot_curves,
    plot_laws,
    plot_measurement,
    plot_microslip,
    plot_optimal,
    plot_over_measurement,
    plot_settled,
    plot_time_sweep,
    plot_verification,
)
from bdamper.plot.design import plot_accuracy, plot_advice, plot_ladder, plot_sweep, plot_uncertain
from bdamper.plot.fatigue import plot_critical, plot_haigh, plot_margin, plot_stress
from bdamper.plot.hysteresis import plot_dissipation, plot_energy, plot_history, plot_hysteresis
from bdamper.plot.model3d import plot_import_report, plot_mode, plot_model, plot_surfaces
from bdamper.plot.modes import plot_flutter, plot_nonlinear_mode
from bdamper.plot.response_map import plot_response_map
from bdamper.plot.speed import plot_campbell, plot_crossings, plot_run_up, plot_safe
from bdamper.plot.together import plot_designs, plot_together
from bdamper.plot.wheel import (
    plot_mistuning,
    plot_sample,
    plot_sample_preload,
    plot_sample_tail,
    plot_wheel,
    plot_wheel_curve,
    plot_wheel_map,
    plot_wheel_optimal,
    plot_wheel_peak,
)

__all__ = [
    "animate_damper",
    "colours",
    "damper_picture",
    "mark_kept",
    "mark_settled",
    "new_axes",
    "plot_accuracy",
    "plot_advice",
    "plot_campbell",
    "plot_contact_map",
    "plot_critical",
    "plot_crossings",
    "plot_curve",
    "plot_curves",
    "plot_designs",
    "plot_dissipation",
    "plot_energy",
    "plot_flutter",
    "plot_haigh",
    "plot_history",
    "plot_hysteresis",
    "plot_import_report",
    "plot_ladder",
    "plot_laws",
    "plot_margin",
    "plot_measurement",
    "plot_microslip",
    "plot_mistuning",
    "plot_mode",
    "plot_model",
    "plot_nonlinear_mode",
    "plot_optimal",
    "plot_over_measurement",
    "plot_peak",
    "plot_response_map",
    "plot_run_up",
    "plot_safe",
    "plot_sample",
    "plot_sample_preload",
    "plot_sample_tail",
    "plot_settled",
    "plot_static",
    "plot_status_bars",
    "plot_status_map",
    "plot_stiffness",
    "plot_stress",
    "plot_surfaces",
    "plot_sweep",
    "plot_time_sweep",
    "plot_together",
    "plot_uncertain",
    "plot_verification",
    "plot_wheel",
    "plot_wheel_curve",
    "plot_wheel_map",
    "plot_wheel_optimal",
    "plot_wheel_peak",
    "save_figure",
]

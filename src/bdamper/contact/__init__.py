"""Contact points: laws, stiffness, static preload, and the range of forces in a wedge.

In: a :class:`bdamper.model.relative_motion.Coupling` and friction coefficients.  Out: `contact_stiffness` by Eqs (1) to
(11) of the paper and by other methods, with residual modes where they are asked for; `static_state`, the quasi-static
contact analysis of section 3.1; `PointArrays`, the parameters of all points under one of the `LAW_...` numbers as the
equations of motion take them; `wedge_friction`, the range of normal forces that statics leaves open.
"""

"""Contact laws, contact stiffness, and static contact under preload.

`contact_stiffness` evaluates Eqs (1) to (11) of the paper and other methods, `residual_flexibility` adds residual vectors.
`static_state` is the quasi-static contact analysis of section 3.1 of the paper.  `wedge_friction` bounds the normal forces
that statics and friction leave open.  `PointArrays` holds the parameters of all contact points in the form that the C core
takes.
"""

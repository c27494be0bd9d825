"""Contact laws, contact stiffness, and static contact under the preload.

`laws` has the contact laws and `PointArrays`, the parameters of all contact points for the C core;
its docstring describes how to add a law.  `stiffness` computes the contact stiffness (paper, Eqs 1
to 11), and `residual_flexibility` the residual modes that complete it.  `static_contact` solves
static contact with friction of the full model and bounds the normal forces on a wedge.
`static_state` computes the mean position, preload and gaps under the load (paper, section 3.1), and
`preload_state` has the result.
"""

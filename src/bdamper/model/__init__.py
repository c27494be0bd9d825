"""The structure: bodies with their modes, interfaces with their contact points, loads, and the relative motion.

In: modal data of bodies at nodal diameters and geometry of interfaces, from a file or built in memory.  Out: a `Model` that
`check_model` accepts, and its `Coupling`, which gives for every harmonic the modes of all bodies and the relative motion at
the contact points (Eqs (13), (14), (17), (18) of the paper), static flexibilities and loads.  `Excitation` and `Response`
say where forces act and where the motion is read, `LocalBasis` holds the blades of a mistuned wheel one by one,
:mod:`bdamper.model.misfit` makes gaps of surfaces that do not fit, and `unite_contact_points` makes a coarser model.
"""

"""The structural model: bodies with their modes, interfaces with contact points, loads, and the model file.

A `Model` holds modal data of its bodies at nodal diameters and the geometry of its interfaces.  `check_model` validates
it, and `Coupling` derives the relative motion at the contact points for every harmonic (Eqs (13), (14), (17), (18) of the
paper) with static flexibilities and loads.  `Excitation` and `Response` define where forces act and where the motion is
read. `load_model` and `save_model` read and write the model file.
"""

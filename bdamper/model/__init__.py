"""Structural model: bodies with their modes, interfaces with contact points, loads, model file.

`structure` defines `Model` and its parts with the conventions of axes and phases; `check_model`
validates it.  `kinematics` computes the relative motion at the contact points for every harmonic
(paper, Eqs 12 to 14, 17 and 18), with residual flexibility and loads.  `Excitation` and `Response`
define forces and responses.  `load_model` and `save_model` read and write the model file.
"""

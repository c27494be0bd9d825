"""From stiffness and mass matrices to the bodies of a model, whatever program assembled them."""

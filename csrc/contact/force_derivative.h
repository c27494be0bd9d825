/* Derivative of the force of a contact point with respect to a parameter of
 * its motion and its law. */
#ifndef BD_CONTACT_FORCE_DERIVATIVE_H
#define BD_CONTACT_FORCE_DERIVATIVE_H

#include "contact/element.h"

/* Compute dF (3, n_coef). `rate` has the derivatives of the numbers of `element`, dX (3, n_coef) is
 * the derivative of the motion X. `response` is the response to X with tangents. */
void bd_force_derivative(const bd_element *element, const bd_element *rate, int n_harm,
                         const double *X, const double *dX, const bd_response *response,
                         double *dF);

#endif

/* Event-driven evaluation of the separable law: coefficients in, coefficients
 * and exact Jacobian out. */
#ifndef BD_CONTACT_EVENT_DRIVEN_H
#define BD_CONTACT_EVENT_DRIVEN_H

#include "contact/event_slider.h"

bd_status bd_event_create(bd_event_work *work, int n_harm);
void bd_event_destroy(bd_event_work *work);

/* x is (3, n_coef): u1, u2, v. The tangent blocks of out may be NULL (all or none), and so may
 * share. work->segment holds the parts of the cycle afterwards. */
void bd_event_evaluate(const bd_element *element, const double *x, bd_response *out,
                       bd_status_share *share, bd_event_work *work);

#endif

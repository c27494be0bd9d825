/* Sampled evaluation of in-plane coupled Coulomb friction, settled over the period. */
#ifndef BD_CONTACT_COUPLED_FRICTION_H
#define BD_CONTACT_COUPLED_FRICTION_H

#include "contact/sticking_slider.h"

/* The tables of the sampled evaluator are used, which must outlive this workspace. */
bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled);
void bd_coulomb_destroy(bd_coulomb_work *work);

/* For n <= BD_LANES points, as bd_sampled_evaluate.  Writes the tangential components of coupled laws; the normal direction
 * and other laws are left as they are.  If a cycle did not settle its force would be NaN. */
void bd_coulomb_evaluate(int n, const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_coulomb_work *work);

#endif

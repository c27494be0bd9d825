/* Sampled evaluation of in-plane coupled Coulomb friction in its steady cycle. */
#ifndef BD_CONTACT_COUPLED_FRICTION_H
#define BD_CONTACT_COUPLED_FRICTION_H

#include "contact/sticking_slider.h"

/* The workspace refers to tables of the sampled evaluation, which must outlive it. */
bd_status bd_coulomb_create(bd_coulomb_work *work, const bd_sampled_work *sampled);
void bd_coulomb_destroy(bd_coulomb_work *work);

/* Evaluate n <= BD_LANES points, like bd_sampled_evaluate. Write the tangential components of
 * coupled laws; the normal direction and other laws remain unchanged. The force is NaN if a cycle
 * does not become steady. */
void bd_coulomb_evaluate(int n, const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_coulomb_work *work);

#endif

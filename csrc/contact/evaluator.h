/* Evaluation of contact points for all laws and methods. */
#ifndef BD_CONTACT_EVALUATOR_H
#define BD_CONTACT_EVALUATOR_H

#include "contact/coupled_friction.h"
#include "contact/event_driven.h"
#include "contact/aft.h"
#include "contact/user_law_aft.h"

typedef enum { BD_EXACT = 0, BD_SAMPLED = 1, BD_SAMPLED_PLAIN = 2 } bd_evaluation;

typedef struct {
    bd_evaluation evaluation;
    int n_harm;
    bd_event_work event;     /* workspace of BD_EXACT */
    bd_sampled_work sampled; /* workspace of the sampled evaluations */
    bd_coulomb_work coulomb; /* workspace of the sampled evaluations */
    bd_user_work user;       /* workspace of user laws, if there are any */
    double *centred;         /* (BD_LANES, 3, n_coef) motion without the tangential means */
    int latest_is_coupled;
} bd_evaluator;

/* n_time is not read for BD_EXACT. */
bd_status bd_evaluator_create(bd_evaluator *evaluator, bd_evaluation evaluation, int n_harm,
                              int n_time);

/* Allocate the work arrays for the user laws among n points (NULL: none). */
bd_status bd_evaluator_add_laws(bd_evaluator *evaluator, int n, const bd_point_law *point_law);

void bd_evaluator_destroy(bd_evaluator *evaluator);

/* Coupled laws and user laws have no exact evaluation. */
static inline int bd_evaluation_supports(bd_evaluation evaluation, bd_law law) {
    return evaluation != BD_EXACT || !(bd_law_is_coupled(law) || law == BD_LAW_USER);
}

void bd_contact_evaluate(const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_evaluator *evaluator);

/* The same for n <= BD_LANES points: element (n), x (n, 3, n_coef), out (n), share (n). */
void bd_contact_evaluate_many(int n, const bd_element *element, const double *x, bd_response *out,
                              bd_status_share *share, bd_evaluator *evaluator);

/* Parts of the cycle of direction d in the latest evaluation of a single point; return
 * their number. It is 0 for user laws, and for a direction without friction unless the
 * contact is always open. */
int bd_contact_segments(const bd_evaluator *evaluator, int d, const bd_segment **segment);

#endif

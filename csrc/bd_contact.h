/* One contact point, whatever its law and however it is evaluated: the switch that the layers above call. */
#ifndef BD_CONTACT_H
#define BD_CONTACT_H

#include "bd_event.h"
#include "bd_sampled.h"

typedef enum { BD_EXACT = 0, BD_SAMPLED = 1, BD_SAMPLED_PLAIN = 2 } bd_evaluation;

typedef struct {
    bd_evaluation evaluation;
    int n_harm;
    union {
        bd_event_work event;
        bd_sampled_work sampled;
    } work;
} bd_evaluator;

/* n_time is not read for BD_EXACT. */
bd_status bd_evaluator_create(bd_evaluator *evaluator, bd_evaluation evaluation, int n_harm, int n_time);
void bd_evaluator_destroy(bd_evaluator *evaluator);

void bd_contact_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_evaluator *evaluator);

/* Parts of the cycle of direction d in the latest evaluation; returns their number. */
int bd_contact_segments(const bd_evaluator *evaluator, int d, const bd_segment **segment);

#endif

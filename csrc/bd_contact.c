/* Dispatch over evaluators; laws are told apart inside them, so that physics is written once. */
#include "bd_contact.h"

bd_status bd_evaluator_create(bd_evaluator *evaluator, bd_evaluation evaluation, int n_harm, int n_time) {
    evaluator->evaluation = evaluation;
    evaluator->n_harm = n_harm;
    if (evaluation == BD_EXACT) return bd_event_create(&evaluator->work.event, n_harm);
    return bd_sampled_create(&evaluator->work.sampled, n_harm, n_time, evaluation == BD_SAMPLED);
}

void bd_evaluator_destroy(bd_evaluator *evaluator) {
    if (!evaluator) return;
    if (evaluator->evaluation == BD_EXACT)
        bd_event_destroy(&evaluator->work.event);
    else
        bd_sampled_destroy(&evaluator->work.sampled);
}

void bd_contact_evaluate(const bd_element *element, const double *x, bd_response *out, bd_status_share *share,
                         bd_evaluator *evaluator) {
    if (evaluator->evaluation == BD_EXACT)
        bd_event_evaluate(element, x, out, share, &evaluator->work.event);
    else
        bd_sampled_evaluate(element, x, out, share, &evaluator->work.sampled);
}

int bd_contact_segments(const bd_evaluator *evaluator, int d, const bd_segment **segment) {
    if (evaluator->evaluation == BD_EXACT) {
        *segment = evaluator->work.event.segment[d];
        return evaluator->work.event.n_segment[d];
    }
    *segment = evaluator->work.sampled.segment[d];
    return evaluator->work.sampled.n_segment[d];
}

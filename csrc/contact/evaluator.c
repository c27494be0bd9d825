/* Event-driven or sampled evaluation. Coupled, cubic and user laws then replace the results at
 * their points. */
#include "contact/evaluator.h"

#include <stdlib.h>
#include <string.h>

/* Create the workspace of event-driven (BD_EXACT) or sampled evaluation; the latter also has
 * coupled friction, which uses its samples. BD_SAMPLED interpolates the instant of a closing. */
bd_status bd_evaluator_create(bd_evaluator *evaluator, bd_evaluation evaluation, int n_harm,
                              int n_time) {
    memset(evaluator, 0, sizeof *evaluator);
    evaluator->evaluation = evaluation;
    evaluator->n_harm = n_harm;
    bd_status status;
    if (evaluation == BD_EXACT) {
        status = bd_event_create(&evaluator->event, n_harm);
    } else {
        status = bd_sampled_create(&evaluator->sampled, n_harm, n_time, evaluation == BD_SAMPLED);
        if (status == BD_OK) status = bd_coulomb_create(&evaluator->coulomb, &evaluator->sampled);
    }
    if (status == BD_OK) {
        evaluator->centred = malloc(sizeof(double) * BD_LANES * 3 * (size_t)bd_n_coef(n_harm));
        if (!evaluator->centred) status = BD_NO_MEMORY;
    }
    if (status != BD_OK) bd_evaluator_destroy(evaluator);
    return status;
}

/* Create the workspace of user laws point_law (n, or NULL), for the law with the most states.
 * The function of a point without user law is NULL. */
bd_status bd_evaluator_add_laws(bd_evaluator *evaluator, int n, const bd_point_law *point_law) {
    if (!point_law) return BD_OK;
    int most_states = -1;
    for (int p = 0; p < n; ++p) {
        const int is_law = point_law[p].function != NULL;
        if (is_law && point_law[p].n_state > most_states) most_states = point_law[p].n_state;
    }
    if (most_states < 0) return BD_OK;
    return bd_user_create(&evaluator->user, &evaluator->sampled, most_states);
}

void bd_evaluator_destroy(bd_evaluator *evaluator) {
    if (!evaluator) return;
    bd_event_destroy(&evaluator->event);
    bd_sampled_destroy(&evaluator->sampled);
    bd_coulomb_destroy(&evaluator->coulomb);
    bd_user_destroy(&evaluator->user);
    free(evaluator->centred);
    evaluator->centred = NULL;
}

/* Replace the results of the friction law at points with cubic springs. These neither stick, slip
 * nor open, so their shares are zero. x (n, 3, n_coef) is the motion of n points. */
static void replace_by_cubic_springs(int n, int n_harm, const bd_element *element, const double *x,
                                     bd_response *out, bd_status_share *share) {
    const size_t motion_size = 3 * (size_t)bd_n_coef(n_harm);
    for (int i = 0; i < n; ++i) {
        if (element[i].law != BD_LAW_CUBIC) continue;
        const double *motion = x + (size_t)i * motion_size;
        bd_element_cubic(&element[i], n_harm, motion, &out[i]);
        share[i] = (bd_status_share){0};
    }
}

/* Copy the motion of n points without their tangential means to evaluator->centred, and the
 * elements with their sliders relative to these means.
 *
 * T = kt (u - w) depends on the difference alone. A body that nothing holds may move far along a
 * face, and rounding of a large u would then exceed a small excitation force. */
static void centre_tangential(int n, const bd_element *element, const double *x,
                              bd_element *centred, const bd_evaluator *evaluator) {
    const size_t n_coef = (size_t)bd_n_coef(evaluator->n_harm);
    memcpy(centred, element, sizeof *element * (size_t)n);
    memcpy(evaluator->centred, x, sizeof(double) * 3 * n_coef * (size_t)n);
    for (int i = 0; i < n; ++i) {
        for (int d = 0; d < 2; ++d) {
            double *mean = evaluator->centred + (3 * (size_t)i + (size_t)d) * n_coef;
            centred[i].w[d] -= *mean;
            *mean = 0.0;
        }
    }
}

/* Forces and tangents out (n) and shares of the cycle (n, or NULL) of n <= BD_LANES points with the
 * motion x (n, 3, n_coef). Friction depends on the motion relative to the slider, so its tangential
 * means are removed before; cubic springs and user laws need the actual motion. */
void bd_contact_evaluate_many(int n, const bd_element *element, const double *x, bd_response *out,
                              bd_status_share *share, bd_evaluator *evaluator) {
    const size_t size = 3 * (size_t)bd_n_coef(evaluator->n_harm);
    bd_status_share unused[BD_LANES];
    bd_element centred[BD_LANES];
    if (!share) share = unused;
    centre_tangential(n, element, x, centred, evaluator);
    const double *motion = evaluator->centred;
    if (evaluator->evaluation == BD_EXACT) {
        for (int i = 0; i < n; ++i)
            bd_event_evaluate(centred + i, motion + (size_t)i * size, out + i, share + i,
                              &evaluator->event);
        replace_by_cubic_springs(n, evaluator->n_harm, element, x, out, share);
        return;
    }

    bd_sampled_evaluate(n, centred, motion, out, share, &evaluator->sampled);
    int has_coupled = 0;
    for (int i = 0; i < n; ++i) has_coupled |= bd_law_is_coupled(element[i].law);
    evaluator->latest_is_coupled = has_coupled;
    if (has_coupled) bd_coulomb_evaluate(n, centred, motion, out, share, &evaluator->coulomb);
    replace_by_cubic_springs(n, evaluator->n_harm, element, x, out, share);
    for (int i = 0; i < n; ++i) {
        if (element[i].law != BD_LAW_USER) continue;
        const double *x_of_point = x + (size_t)i * size;
        bd_user_evaluate(element + i, x_of_point, out + i, share + i, &evaluator->user);
    }
}

void bd_contact_evaluate(const bd_element *element, const double *x, bd_response *out,
                         bd_status_share *share, bd_evaluator *evaluator) {
    bd_contact_evaluate_many(1, element, x, out, share, evaluator);
}

/* Parts of the cycle of direction d of the point that was evaluated last, alone; return their
 * number. Both directions of coupled friction have the same parts. */
int bd_contact_segments(const bd_evaluator *evaluator, int d, const bd_segment **segment) {
    if (evaluator->evaluation == BD_EXACT) {
        *segment = evaluator->event.segment[d];
        return evaluator->event.n_segment[d];
    }
    if (evaluator->latest_is_coupled) {
        *segment = evaluator->coulomb.segment;
        return evaluator->coulomb.n_segment;
    }
    *segment = evaluator->sampled.segment[d];
    return evaluator->sampled.n_segment[d];
}

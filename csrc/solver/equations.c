/* Checked calls of equations, in the order evaluate (r, J and C at y), factor (B), solve. */
#include "solver/equations.h"

bd_status bd_evaluate(bd_equations *e, const double *y, int derivative) {
    e->stage = BD_EMPTY;
    const bd_status status = e->type->evaluate(e, y, derivative);
    if (status != BD_OK) return status;
    e->stage = derivative ? BD_DERIVED : BD_EVALUATED;
    return BD_OK;
}

bd_status bd_trial(bd_equations *e, const double *y) {
    const bd_status status = e->type->evaluate(e, y, e->derives_trials);
    if (status != BD_OK) e->stage = BD_EMPTY;
    return status;
}

bd_status bd_product(bd_equations *e, int transposed, const double *x, double *out) {
    if (e->stage < BD_DERIVED) return BD_BAD_STATE;
    if (!e->J) return e->type->product(e, transposed, x, out);
    const size_t n = (size_t)e->n;
    for (size_t i = 0; i < n; ++i) out[i] = 0.0;
    for (size_t i = 0; i < n; ++i) {
        const double *row = e->J + i * n;
        for (size_t j = 0; j < n; ++j) {
            if (transposed)
                out[j] += row[j] * x[i];
            else
                out[i] += row[j] * x[j];
        }
    }
    return BD_OK;
}

bd_status bd_factor(bd_equations *e, const bd_border *border) {
    if (e->stage < BD_DERIVED) return BD_BAD_STATE;
    e->stage = BD_DERIVED; /* the factors of an earlier border are no longer valid */
    const bd_status status = e->type->factor(e, border);
    if (status != BD_OK) return status;
    e->stage = BD_FACTORED;
    return BD_OK;
}

bd_status bd_solve_linear(bd_equations *e, double tolerance, double *b) {
    if (e->stage < BD_FACTORED) return BD_BAD_STATE;
    return e->type->solve(e, tolerance, b);
}

bd_status bd_solve_transposed(bd_equations *e, double *b) {
    if (e->stage < BD_FACTORED || !e->type->solve_transposed) return BD_BAD_STATE;
    return e->type->solve_transposed(e, b);
}

void bd_equations_destroy(bd_equations *e) {
    if (e) e->type->destroy(e);
}

/* Lack of memory at any allocation: creation returns the status and leaves no memory allocated. The
 * linker redirects the allocations of the core to the functions here. */
#include "balance/sector.h"
#include "balance/nonlinear_mode.h"
#include "time/integration.h"
#include "check.h"

#include <limits.h>

static int left = INT_MAX; /* allocations that still succeed */
static int n_live;

void *__real_malloc(size_t size);
void *__real_calloc(size_t n, size_t size);
void __real_free(void *memory);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t n, size_t size);
void __wrap_free(void *memory);

static void *counted(void *memory) {
    n_live += memory != NULL;
    return memory;
}

void *__wrap_malloc(size_t size) { return left-- > 0 ? counted(__real_malloc(size)) : NULL; }

void *__wrap_calloc(size_t n, size_t size) {
    return left-- > 0 ? counted(__real_calloc(n, size)) : NULL;
}

void __wrap_free(void *memory) {
    n_live -= memory != NULL;
    __real_free(memory);
}

typedef struct {
    bd_evaluation evaluation;
    bd_elimination elimination;
    bd_evaluator evaluator;
    bd_hbm hbm;
    bd_sector *sector;
    bd_equations *other;
    bd_time time;
} workspaces;

static const double own_numbers[6] = {1.0, 1.0, 0.5, 1.0, 0.5, 1.0};
static const bd_point_law own_law = {.function = bd_law_bouc_wen,
                                     .n_parameter = 6,
                                     .n_state = 2,
                                     .parameter = own_numbers,
                                     .memory = own_numbers};

static bd_status create_evaluator(workspaces *w) {
    const bd_status status = bd_evaluator_create(&w->evaluator, w->evaluation, 2, 64);
    if (status != BD_OK || w->evaluation == BD_EXACT) return status;
    const bd_status more = bd_evaluator_add_laws(&w->evaluator, 1, &own_law);
    if (more != BD_OK) bd_evaluator_destroy(&w->evaluator);
    return more;
}

static void destroy_evaluator(workspaces *w) { bd_evaluator_destroy(&w->evaluator); }

static bd_status create_sector(workspaces *w) {
    const int n_mode[3] = {1, 2, 0},
              law[1] = {w->evaluation == BD_EXACT ? BD_LAW_SEPARABLE : BD_LAW_USER};
    const double one[3] = {1.0, 1.0, 1.0}, G[2 * 3 * 3] = {1.0}, none[5] = {0.0};
    const bd_hbm_input input = {.n_point = 1,
                                .n_harm = 2,
                                .n_mode = n_mode,
                                .stiffness = one,
                                .mass = one,
                                .damping = one,
                                .G = G,
                                .kt = one,
                                .kn = one,
                                .mu = one,
                                .n0 = one,
                                .w = none,
                                .law = law,
                                .shift = none,
                                .force = none,
                                .evaluation = w->evaluation,
                                .n_time = 64,
                                .point_law = w->evaluation == BD_EXACT ? NULL : &own_law};
    const bd_lapack lapack = bd_lapack_system();
    return bd_sector_create(&w->sector, &input, NULL, &lapack, w->elimination);
}

static void destroy_sector(workspaces *w) {
    if (w->sector) bd_equations_destroy(&w->sector->dense.base);
    w->sector = NULL;
}

/* The sector with its eased equations or its nonlinear modes; another case
 * tests the sector alone. */
static bd_status create_eased(workspaces *w) {
    const double ramp[5] = {1.0}, support[25] = {1.0};
    bd_status status = create_sector(w);
    if (status == BD_OK) status = bd_eased_create(&w->other, w->sector, 1.0, ramp, support);
    if (status != BD_OK) destroy_sector(w);
    return status;
}

static bd_status create_modes(workspaces *w) {
    const double shape[5] = {0.0, 1.0}, row_scale[7] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
    bd_status status = create_sector(w);
    if (status == BD_OK)
        status = bd_modes_create(&w->other, w->sector, shape, shape, 1.0, row_scale);
    if (status != BD_OK) destroy_sector(w);
    return status;
}

static void destroy_other(workspaces *w) {
    bd_equations_destroy(w->other);
    w->other = NULL;
    destroy_sector(w);
}

static bd_status create_time(workspaces *w) {
    const int one = 1, none[2] = {0}, user = BD_LAW_USER;
    const double unit[6] = {1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
    const bd_time_input input = {.n_sector = 1,
                                 .n_point = 1,
                                 .n_family = 1,
                                 .n_mode = &one,
                                 .diameter = none,
                                 .stiffness = unit,
                                 .mass = unit,
                                 .damping = unit,
                                 .G = unit,
                                 .kt = unit,
                                 .kn = unit,
                                 .mu = unit,
                                 .n0 = unit,
                                 .load = unit,
                                 .shift = unit,
                                 .law = &user,
                                 .point_law = &own_law,
                                 .fixed_slider = none,
                                 .response_row = unit};
    return bd_time_create(&w->time, &input);
}

static void destroy_time(workspaces *w) { bd_time_destroy(&w->time); }

static void test_each_allocation(workspaces options, bd_status (*create)(workspaces *),
                                 void (*destroy)(workspaces *)) {
    workspaces w = options;
    for (int n = 0; n < 100; ++n) {
        left = n;
        const bd_status status = create(&w);
        left = INT_MAX;
        if (status == BD_OK) {
            CHECK(n > 1 && n_live > 1 && n_live <= n);
            destroy(&w);
            CHECK(n_live == 0);
            return;
        }
        CHECK(status == BD_NO_MEMORY);
        CHECK(n_live == 0);
        n_live = 0;
        destroy(&w); /* a second call is allowed */
        CHECK(n_live == 0);
    }
    CHECK(0);
}

int main(void) {
    const bd_evaluation evaluation[3] = {BD_EXACT, BD_SAMPLED, BD_SAMPLED_PLAIN};
    for (int i = 0; i < 3; ++i) {
        const workspaces options = {.evaluation = evaluation[i]};
        test_each_allocation(options, create_evaluator, destroy_evaluator);
        test_each_allocation(options, create_sector, destroy_sector);
    }
    const workspaces full = {.evaluation = BD_EXACT, .elimination = BD_FULL};
    const workspaces condensed = {.evaluation = BD_EXACT, .elimination = BD_CONDENSED};
    test_each_allocation(condensed, create_sector, destroy_sector);
    test_each_allocation(condensed, create_eased, destroy_other);
    test_each_allocation(condensed, create_modes, destroy_other);
    test_each_allocation(full, create_eased, destroy_other);
    test_each_allocation(full, create_modes, destroy_other);
    test_each_allocation(full, create_time, destroy_time);
    return check_result();
}

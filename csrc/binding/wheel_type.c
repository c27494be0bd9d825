/* bdamper._core.Wheel: equations of a mistuned bladed disk from arrays. */
#include "binding/binding.h"

/* Arguments of Wheel(), in order. */
typedef struct {
    PyObject *next, *rows, *active, *pinned, *stiffness, *mass, *disk_stiffness, *disk_mass,
        *damping;
    PyObject *damper_stiffness, *damper_mass, *damper_damping, *springs, *neutral, *home;
    PyObject *kt, *kn, *mu, *n0, *w, *law, *load, *shift, *force, *row_scale;
} wheel_objects;

static unsigned char *flags(core_arguments *a, PyObject *object, const char *name, npy_intp n) {
    return core_array(a, object, name, NPY_BOOL, "bool", 1, &n, BD_INPUT);
}

/* Complex matrices (n_wave, n, n). */
static const double *waves(core_arguments *a, PyObject *object, const char *name, npy_intp n_wave,
                           npy_intp n) {
    const npy_intp shape[3] = {n_wave, n, n};
    const double *found =
        core_array(a, object, name, NPY_CDOUBLE, "complex128", 3, shape, BD_INPUT);
    return found && core_check_numbers(found, 2 * n_wave * n * n, name, BD_FINITE) ? found : NULL;
}

/* Largest number of entries of an array, so that indices fit into int. */
static const double MOST = 1 << 28;

/* Return whether all sizes are in their ranges; products are doubles, which do not overflow. */
static int check_sizes(const bd_wheel_input *in) {
    if (!core_check_n_harm(in->n_harm)) return 0;
    const double n_sector = in->n_sector, n_blade = in->n_blade;
    const double sector_size = n_blade + in->n_damper;
    const double n_coef = 2.0 * in->n_harm + 1.0;
    const double vector_size = n_sector * n_coef * sector_size;
    const double n_motion = 3.0 * n_sector * n_coef * in->n_point;
    const double n_stiffness = n_sector * n_blade * n_blade;
    if (vector_size > MOST || n_motion > MOST || n_stiffness > MOST) {
        PyErr_Format(
            PyExc_ValueError,
            "n_sector, n_harm, n_blade, n_damper, n_point: expected at most %d numbers in an array",
            (int)MOST);
        return 0;
    }
    const int good_sector = in->n_sector >= 3 && in->n_sector <= 10000;
    const int good_bodies = in->n_blade >= 1 && in->n_damper >= 0 && sector_size <= 1000.0;
    const int good_root = in->n_root >= 0 && in->n_root <= in->n_blade;
    const int good_kept = in->n_kept >= 0 && in->n_kept <= in->n_root;
    const int has_ring = in->n_kept || in->n_damper;
    const int good_points = in->n_point >= 0 && in->n_point <= 100000;
    if (good_sector && good_bodies && good_root && good_kept && has_ring && good_points) return 1;
    PyErr_SetString(
        PyExc_ValueError,
        "n_sector, n_blade, n_damper, n_root, n_kept, n_point: expected 3 to 10000 sectors, "
        "n_kept <= n_root <= n_blade, n_kept or n_damper above 0, at most 1000 coordinates and "
        "100000 points in a sector");
    return 0;
}

/* Return whether cosine and sine of each harmonic are active together. */
static int check_pairs(const unsigned char *active, npy_intp n_coef) {
    for (npy_intp cosine = 1; cosine < n_coef; cosine += 2) {
        if (active[cosine] == active[cosine + 1]) continue;
        PyErr_SetString(PyExc_ValueError,
                        "active: expected cosine and sine of a harmonic together");
        return 0;
    }
    return 1;
}

/* Matrices of blades, disk and dampers. */
static int read_structure(core_arguments *a, const wheel_objects *o, bd_wheel_input *in) {
    const npy_intp n_sector = in->n_sector, n_wave = n_sector / 2 + 1;
    const npy_intp n_blade = in->n_blade, n_damper = in->n_damper;
    const npy_intp n_coef = bd_n_coef(in->n_harm);
    const npy_intp rows[3] = {in->n_point, 3, n_blade + n_damper};
    const npy_intp blades[3] = {n_sector, n_blade, n_blade}, blade[2] = {n_blade, n_blade};
    const npy_intp dampers[2] = {n_sector, n_damper};
    if (!(in->on_next = flags(a, o->next, "next", in->n_point))) return 0;
    if (!(in->motion_rows = core_numbers(a, o->rows, "rows", 3, rows, BD_FINITE))) return 0;
    if (!(in->active = flags(a, o->active, "active", n_coef))) return 0;
    if (!(in->pinned = flags(a, o->pinned, "pinned", n_sector))) return 0;
    if (!check_pairs(in->active, n_coef)) return 0;

    in->stiffness = core_numbers(a, o->stiffness, "stiffness", 3, blades, BD_FINITE);
    if (!in->stiffness) return 0;
    in->mass = core_numbers(a, o->mass, "mass", 2, blade, BD_FINITE);
    if (!in->mass) return 0;
    in->disk_stiffness = waves(a, o->disk_stiffness, "disk_stiffness", n_wave, in->n_root);
    if (!in->disk_stiffness) return 0;
    in->disk_mass = waves(a, o->disk_mass, "disk_mass", n_wave, in->n_root);
    if (!in->disk_mass) return 0;
    in->damping = waves(a, o->damping, "damping", n_wave, n_blade);
    if (!in->damping) return 0;

    in->damper_stiffness =
        core_numbers(a, o->damper_stiffness, "damper_stiffness", 1, &n_damper, BD_FINITE);
    if (!in->damper_stiffness) return 0;
    in->damper_mass = core_numbers(a, o->damper_mass, "damper_mass", 2, dampers, BD_FINITE);
    if (!in->damper_mass) return 0;
    in->damper_damping =
        core_numbers(a, o->damper_damping, "damper_damping", 1, &n_damper, BD_FINITE);
    if (!in->damper_damping) return 0;
    in->springs = core_numbers(a, o->springs, "springs", 2, dampers, BD_NON_NEGATIVE);
    if (!in->springs) return 0;
    in->jacobian_springs = core_numbers(a, o->neutral, "neutral", 2, dampers, BD_NON_NEGATIVE);
    if (!in->jacobian_springs) return 0;
    in->spring_origin = core_numbers(a, o->home, "home", 2, dampers, BD_FINITE);
    return in->spring_origin != NULL;
}

/* Parameters of the contact points of all sectors. */
static int read_points(core_arguments *a, const wheel_objects *o, bd_wheel_input *in) {
    const npy_intp n = in->n_sector * (npy_intp)in->n_point;
    const npy_intp by2[2] = {n, 2}, by3[2] = {n, 3};
    if (!(in->kt = core_numbers(a, o->kt, "kt", 2, by2, BD_FINITE))) return 0;
    if (!(in->kn = core_numbers(a, o->kn, "kn", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(in->mu = core_numbers(a, o->mu, "mu", 1, &n, BD_NON_NEGATIVE))) return 0;
    if (!(in->n0 = core_numbers(a, o->n0, "n0", 1, &n, BD_FINITE))) return 0;
    if (!(in->w = core_doubles(a, o->w, "w", 2, by2, BD_INPUT))) return 0;
    if (!(in->law = core_array(a, o->law, "law", NPY_INT, "intc", 1, &n, BD_INPUT))) return 0;
    if (!(in->load = core_numbers(a, o->load, "load", 1, &n, BD_FINITE))) return 0;
    if (!(in->shift = core_numbers(a, o->shift, "shift", 2, by3, BD_FINITE))) return 0;
    for (npy_intp p = 0; p < n; ++p) {
        if (!core_check_law(in->law[p], in->evaluation)) return 0;
        if (!core_check_slider(in->w + 2 * p, in->law[p])) return 0;
    }
    return 1;
}

/* Forces and scales of the unknowns. */
static int read_forces(core_arguments *a, const wheel_objects *o, bd_wheel_input *in) {
    npy_intp n_active = 0;
    for (int c = 0; c < bd_n_coef(in->n_harm); ++c) n_active += in->active[c] != 0;
    const npy_intp n = n_active * (npy_intp)in->n_sector * (in->n_blade + in->n_damper);
    if (n < 1) {
        PyErr_SetString(PyExc_ValueError, "active: expected at least one coefficient, found none");
        return 0;
    }
    if (!(in->force = core_numbers(a, o->force, "force", 1, &n, BD_FINITE))) return 0;
    in->row_scale = core_numbers(a, o->row_scale, "row_scale", 1, &n, BD_POSITIVE);
    return in->row_scale != NULL;
}

static PyObject *Wheel_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"n_sector",
                            "n_harm",
                            "n_blade",
                            "n_damper",
                            "n_root",
                            "n_kept",
                            "n_point",
                            "next",
                            "rows",
                            "active",
                            "pinned",
                            "stiffness",
                            "mass",
                            "disk_stiffness",
                            "disk_mass",
                            "damping",
                            "damper_stiffness",
                            "damper_mass",
                            "damper_damping",
                            "springs",
                            "neutral",
                            "home",
                            "kt",
                            "kn",
                            "mu",
                            "n0",
                            "w",
                            "law",
                            "load",
                            "shift",
                            "force",
                            "row_scale",
                            "evaluation",
                            "n_time",
                            NULL};
    wheel_objects o;
    bd_wheel_input in = {0};
    core_arguments a = {0};
    int evaluation = BD_EXACT;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "iiiiiiiOOOOOOOOOOOOOOOOOOOOOOOOO|ii:Wheel",
                                     names, &in.n_sector, &in.n_harm, &in.n_blade, &in.n_damper,
                                     &in.n_root, &in.n_kept, &in.n_point, &o.next, &o.rows,
                                     &o.active, &o.pinned, &o.stiffness, &o.mass, &o.disk_stiffness,
                                     &o.disk_mass, &o.damping, &o.damper_stiffness, &o.damper_mass,
                                     &o.damper_damping, &o.springs, &o.neutral, &o.home, &o.kt,
                                     &o.kn, &o.mu, &o.n0, &o.w, &o.law, &o.load, &o.shift, &o.force,
                                     &o.row_scale, &evaluation, &in.n_time))
        return NULL;
    if (!core_check_kernel() || !check_sizes(&in) ||
        !core_check_evaluation(evaluation, in.n_time, in.n_harm))
        return NULL;
    in.evaluation = (bd_evaluation)evaluation;
    if (!read_structure(&a, &o, &in) || !read_points(&a, &o, &in) || !read_forces(&a, &o, &in))
        return NULL;
    core_equations *self = core_equations_new(type, NULL);
    if (!self) return NULL;
    if (!core_check_status(bd_wheel_create(&self->wheel, &in))) {
        Py_DECREF(self);
        return NULL;
    }
    self->equations = &self->wheel->base;
    return (PyObject *)self;
}

static PyType_Slot Wheel_slots[] = {{Py_tp_new, Wheel_new},
                                    {Py_tp_dealloc, core_equations_dealloc},
                                    {Py_tp_methods, core_equations_methods},
                                    {Py_tp_getset, core_equations_getset},
                                    {Py_tp_doc,
                                     "Harmonic balance equations of a mistuned bladed disk from "
                                     "arrays (csrc/bladed_disk/wheel_equations.h); "
                                     "the parameter is omega."},
                                    {0, NULL}};

PyType_Spec core_wheel_spec = {.name = "bdamper._core.Wheel",
                               .basicsize = sizeof(core_equations),
                               .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
                               .slots = Wheel_slots};

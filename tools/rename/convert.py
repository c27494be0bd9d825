"""Stored results follow the names: convert.py ROOT"""
import h5py, json, pathlib, subprocess, sys
root = pathlib.Path(sys.argv[1])
FIELDS = {"kept": "time_response", "left_out": "missing_ranges", "scan": "search_status", "meetings": "internal_resonances", "least_in_time": "optimum_in_time",
          "called_for": "significant", "no_steady_below": "lowest_steady_preload"}
KEYS = {"constraints": "constraint_planes", "loads": "load_per_preload", "fixed_loads": "constant_loads", "single_basis": "fundamental_modes_only",
        "slip_offset": "residual_slip_std", "slip_offset_seed": "residual_slip_seed", "evaluation": "contact_forces", "patterns": "n_vectors"}
VALUES = {"exact": "event_driven", "separable": "uncoupled", "eq4": "cigeroglu2009"}
def walk(x):
    if isinstance(x, dict): return {KEYS.get(k, k): walk(v) for k, v in x.items()}
    if isinstance(x, list): return [walk(v) for v in x]
    return VALUES.get(x, x) if isinstance(x, str) else x
def group(g):
    n = 0
    for k in list(g.attrs):
        v = g.attrs[k]; new = v
        if isinstance(v, str) and v[:1] in "{[":
            try: new = json.dumps(walk(json.loads(v)))
            except ValueError: pass
        if k in FIELDS or new != v if isinstance(v, str) else k in FIELDS:
            del g.attrs[k]; g.attrs[FIELDS.get(k, k)] = new; n += 1
    for k in list(g):
        o = g[k]
        if isinstance(o, h5py.Group): n += group(o)
        elif o.shape == () and o.dtype.kind == "O":
            v = o[()].decode()
            try: new = json.dumps(walk(json.loads(v)))
            except ValueError: new = VALUES.get(v, v)
            if json.loads(v) != json.loads(new) if v[:1] in "{[\"" else new != v:
                a = dict(o.attrs); del g[k]; g[k] = new; g[k].attrs.update(a); n += 1
        if k in FIELDS: g.move(k, FIELDS[k]); n += 1
    return n
for p in [root / "src/bdamper/data/wheels.h5", *sorted((root / "examples/converged").glob("*.h5"))]:
    with h5py.File(p, "r+") as f: print(p.name, group(f))

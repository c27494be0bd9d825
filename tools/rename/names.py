"""Renames public and private names: names.py ROOT.  Modes: n any name, a attribute, k keyword or parameter or field, s whole string, c code span in text."""
import ast, io, pathlib, re, subprocess, sys, tokenize
root = pathlib.Path(sys.argv[1])
RULES = []
def rule(old, new, modes, where="", but=""): RULES.append((old, new, modes, re.compile(where), re.compile(but) if but else None))
ANY = "nsc"
# response
rule("Curve", "ResponseCurve", ANY)
rule("track", "frequency_response", "naksc", but=r"^tools/call_depth|\.html$")
rule("sweep_in_time", "frequency_sweep", ANY)
rule("plot_time_sweep", "plot_frequency_sweep", ANY)
rule("least_in_time", "optimum_in_time", ANY)
rule("with_kept", "with_time_response", ANY)
rule("Marched", "TimeResponse", ANY)
rule("march", "time_integration", "aksc", where=r"util/(test_)?cost")
rule("march", "time_integration", "k", where=r"time_domain/integration")
rule("march", "time_response", "ac", but=r"util/(test_)?cost")
KEPT = r"^src/bdamper/(response|mistuning|plot/(curves|report|overlay|wheel|explorer_page)|study|time_domain|analyses|fatigue|__main__|lumped)|^tests|^examples|^benchmarks|^tools|^notebooks|^docs"
rule("kept", "time_response", "aksc", where=KEPT, but=r"fem/|importers/|test_(local|modal|model_file|residual|cyclic|io_)|response/(continuation|branches|events)|explorer_worker|mistuning/(mistuning|sample)|test_mistuning|test_sample")
rule("mark_kept", "mark_time_response", ANY)
rule("with_", "replace", "ac")
rule("converge", "harmonic_convergence", "aksc")
rule("meetings", "internal_resonances", "naksc", but=r"^(csrc|tests/oracle)")
rule("limit", "highest_harmonic", "ak", where=r"convergence_result|test_converge|harmonic_convergence")
rule("advise", "effect_significance", ANY)
rule("Advice", "EffectSignificance", ANY)
rule("plot_advice", "plot_effect_significance", ANY)
rule("called_for", "significant", ANY)
rule("misfit", "face_gap", "nc", where=r"^(src/bdamper/__init__|src/bdamper/model/surface_misfit|tests/model/test_misfit)")
rule("Test", "MeasuredResponse", "nc", where=r"^(src|tests/analyses/test_fit|docs/fit|docs/api|examples|notebooks|tests/examples/test_fit)")
rule("draw", "sample", "nc", where=r"^(src/bdamper/analyses/uncertainty|src/bdamper/__init__)")
rule("draw", "sample", "ac", where=r"^(tests/analyses/test_sweep|tests/harmonic_balance/test_slip_offset|docs/nonlinear-modes|notebooks/result_pictures|docs/api|docs/how-to)")
rule("uncertain_curve", "optimal_curve_uncertainty", ANY)
rule("UncertainCurve", "OptimalCurveUncertainty", ANY)
rule("plot_uncertain", "plot_optimal_curve_uncertainty", ANY)
rule("PAPER", "CIGEROGLU_2009", "nc", where=r"^src/bdamper/(__init__|harmonic_balance)|^docs/api|reference_models")
rule("PAPER", "CIGEROGLU_2009", "x", where=r"")
rule("eq4", "cigeroglu2009", "s", but=r"^src/bdamper/model/structure|test_model_file|test_validation")
rule("eq4", "cigeroglu2009", "sc")
rule("Sampled", "AFT", ANY)
rule("evaluation", "contact_forces", "aksc", where=r"^(src|docs|examples|notebooks|benchmarks|tests/(hard|physics|analyses|response|time_domain|contact|harmonic_balance|util|golden|examples|model|mistuning|fatigue|plot|[a-z_]+\.py))", but=r"_core\.pyi|tests/oracle")
rule("evaluation", "contact_forces", "n", where=r"^src/bdamper/(contact/law_codes|harmonic_balance/(sector|settings)|mistuning/wheel_equations|time_domain/integration)")
rule("exact", "event_driven", "s")
rule("separable", "uncoupled", "s")
rule("constraints", "constraint_planes", "aks", where=r"^(src/bdamper/(harmonic_balance|analyses)|tests|examples|benchmarks|tools|docs|notebooks)")
rule("constraints", "constraint_planes", "n", where=r"^src/bdamper/harmonic_balance/(settings|effects)")
rule("fixed_loads", "constant_loads", ANY)
LOADS = r"^(tests|examples|benchmarks|docs|notebooks|tools|src/bdamper/(harmonic_balance|analyses|response|plot|util/formatting|study|lumped_masses))"
rule("loads", "load_per_preload", "sk", where=LOADS, but=r"fem/|full_static|test_cyclic|test_free_body|oscillators")
rule("loads", "load_per_preload", "a", where=r"^src/bdamper/harmonic_balance/(settings|normal_loads|problem|plausib)|^src/bdamper/analyses/sweep")
rule("single_basis", "fundamental_modes_only", ANY)
rule("slip_offset", "residual_slip_std", ANY)
rule("slip_offset_seed", "residual_slip_seed", ANY)
rule("patterns", "n_vectors", "ak", where=r"residual_flexibility|contact/stiffness|test_residual_modes|test_hysteresis|harmonic_balance/settings|contact-stiffness")
rule("Wheel", "BladedDisk", ANY, but=r"_core\.pyi")
rule("drawn", "random", "ac", but=r"^src/bdamper/(plot|mistuning/sample_result)")
rule("crossings", "resonance_crossings", "a", where=r"^(src/bdamper/(study|analyses/crossings|__main__|plot)|tests|examples|benchmarks|notebooks|docs)")
rule("left_out", "missing_ranges", "aksc", where=r"^(src/bdamper/(response|plot/curves|study|time_domain|harmonic_balance/result)|tests/(response|hard|time_domain|harmonic_balance|plot|examples|[a-z_]+.py)|docs|benchmarks|examples|notebooks)", but=r"contact|test_effect|fit")
rule("no_steady_below", "lowest_steady_preload", ANY)
rule("scan", "search_status", "aksc", but=r"checkpoint_file")
rule("stress_at", "gauge_stress", ANY)

def code_span(text, old, new):
    o = re.escape(old)
    text = re.sub(rf"(?<=[`.]){o}(?=[`(.\]])", new, text)          # `track`, .track(, `track(...)`
    text = re.sub(rf"(?<=~){o}\b", new, text)
    text = re.sub(rf"(?m)^(\s*(?:[\w]+, )*){o}(?=(?:, \w+)* : )", rf"\1{new}", text)  # numpydoc parameters
    return text

def python(text, rules):
    toks = list(tokenize.generate_tokens(io.StringIO(text).readline))
    lines = text.splitlines(keepends=True)
    pos = [0]
    for l in lines: pos.append(pos[-1] + len(l))
    at = lambda p: pos[p[0] - 1] + p[1]
    col = lambda n: (n.lineno, len(lines[n.lineno - 1].encode()[: n.col_offset].decode()))
    tree = ast.parse(text)
    olds = {o for o, _, _ in rules}
    fields, keywords, spans = set(), set(), []
    for n in ast.walk(tree):
        if isinstance(n, ast.ClassDef):
            for b in n.body:
                if isinstance(b, ast.AnnAssign) and isinstance(b.target, ast.Name): fields.add(col(b.target))
                if isinstance(b, ast.Assign):
                    for t in b.targets:
                        if isinstance(t, ast.Name): fields.add(col(t))
                if isinstance(b, (ast.FunctionDef, ast.AsyncFunctionDef)): fields.add((b.lineno, b.name))
        if isinstance(n, ast.keyword) and n.arg in olds: keywords.add(col(n))
        if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            a = n.args
            for x in [*a.posonlyargs, *a.args, *a.kwonlyargs]:
                if x.arg in olds: spans.append((x.arg, n.lineno, n.end_lineno))
    module_defs = {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}
    edits = []
    code = [t for t in toks if t.type not in (tokenize.NL, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT)]
    prev = {id(t): code[i - 1] for i, t in enumerate(code) if i}
    for t in toks:
        if t.type == tokenize.NAME and t.string in olds:
            p = prev.get(id(t)); ps = p.string if p else ""
            attr = ps == "."
            kw = t.start in keywords
            method = ps == "def" and (t.start[0], t.string) in fields
            field = t.start in fields or method
            inspan = not attr and not kw and any(o == t.string and a <= t.start[0] <= b for o, a, b in spans)
            impath = re.match(r"\s*from ", t.line) and " import " in t.line and t.start[1] < t.line.index(" import ")
            local = t.string in module_defs and not attr and not kw and not any(o == t.string and a <= t.start[0] <= b for o, a, b in spans) and not re.match(r"\s*(from|import) ", t.line)
            if impath: continue
            core = attr and prev[id(p)].string in ("_core", "json", "pickle") or kw and re.search(r"_core\.|WheelCore\(|\*\*given, evaluation", t.line)
            for old, new, modes in rules:
                if t.string != old or core: continue
                if ("n" in modes or ("a" in modes and (attr or field or local)) or ("k" in modes and (kw or field or inspan))
                        or ("x" in modes and attr and prev[id(p)].string == "bd")):
                    edits.append((at(t.start), at(t.end), new)); break
        elif t.type == tokenize.STRING:
            s = t.string
            body = re.sub(r"^[rbfuRBFU]*", "", s)
            triple = body[:3] in ('"""', "'''")
            inner = body[3:-3] if triple else body[1:-1]
            new_inner = inner
            fstring = "f" in s[: len(s) - len(body)].lower()
            for old, new, modes in rules:
                if not triple and inner == old and "s" in modes: new_inner = new; break
                if not triple and "s" in modes and old in ("loads", "fixed_loads", "constraints") : new_inner = re.sub(rf"^{old}(?=\.)", new, new_inner)
                if "c" in modes: new_inner = code_span(new_inner, old, new)
                if fstring:
                    if "n" in modes or any(o == old and a <= t.start[0] <= b for o, a, b in spans) and "k" in modes: new_inner = re.sub(rf"(?<=[{{(, *]){re.escape(old)}(?=[.(}}:!])(?=[^{{]*}})", new, new_inner)
                    if "a" in modes: new_inner = re.sub(rf"(?<=\w\.){re.escape(old)}(?=[.(}}:!,)])", new, new_inner)
                if "n" in modes and (triple or " " in inner) and old not in ("track", "Test", "misfit", "draw", "limit", "evaluation", "constraints"): new_inner = re.sub(rf"(?<![\w-]){re.escape(old)}(?![\w-])", new, new_inner)
            if new_inner != inner:
                i = at(t.start) + len(s) - len(body) + (3 if triple else 1)
                edits.append((i, i + len(inner), new_inner))
        elif t.type == tokenize.COMMENT:
            new = t.string
            for old, n_, modes in rules:
                if "c" in modes: new = code_span(new, old, n_)
            if new != t.string: edits.append((at(t.start), at(t.end), new))
    for s, e, new in sorted(edits, reverse=True): text = text[:s] + new + text[e:]
    return text

def prose(text, rules):
    for old, new, modes in rules:
        if "c" in modes: text = code_span(text, old, new)
        if "k" in modes: text = re.sub(rf"(?<=[(, ]){re.escape(old)}(?==[^=])", new, text)
        if "n" in modes and old not in ("track", "Test", "misfit", "Curve", "Wheel"): text = re.sub(rf"(?<![\w-]){re.escape(old)}(?![\w-])", new, text)
        elif "n" in modes: text = re.sub(rf"(?<=bd\.){re.escape(old)}\b|(?<=import ){re.escape(old)}\b", new, text)
    return text

for name in subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True).stdout.split("\n"):
    p = root / name
    if not name or name.startswith(("CHANGELOG", "tools/rename")) or p.suffix not in {".py", ".md", ".ipynb", ".pyi", ".html", ".sh"}: continue
    rules = [(o, n, m) for o, n, m, where, but in RULES if where.search(name) and not (but and but.search(name))]
    text = p.read_text(encoding="utf-8")
    new = python(text, rules) if p.suffix in (".py", ".pyi") else prose(text, rules)
    if new != text: p.write_text(new, encoding="utf-8")

# edits by hand
p = root / "src/bdamper/study.py"; s = p.read_text()
s = re.sub(r"    def time_response\(self, result.*?return self\.time_response\(.*?\)\n\n", "", s, flags=re.S)
s = s.replace("crossings.crossings", "crossings.resonance_crossings")
p.write_text(s)
def sub(path, *pairs):
    p = root / path; s = p.read_text()
    for a, b in pairs:
        assert a in s, (path, a); s = s.replace(a, b)
    p.write_text(s)
sub("src/bdamper/mistuning/wheel.py", ("import kept\n", "import time_response\n"), ("time_response = kept\n", "time_response = time_response\n"))
sub("tests/analyses/test_best_margin.py" if (root / "tests/analyses/test_best_margin.py").exists() else "tests/response/test_best_margin.py", ("*_, time_response=time_response, **__: replace(c, time_response=(time_response,))", "*_, time_response=kept, **__: replace(c, time_response=(time_response,))"))

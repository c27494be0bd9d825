"""Moves and renames the modules: move.py ROOT.  Run on a clean tree."""
import ast, io, json, pathlib, re, subprocess, sys, tokenize, collections
sys.path.insert(0, str(pathlib.Path(__file__).parent))
from modules import mapping
root = pathlib.Path(sys.argv[1]); pkg = root / "src/bdamper"
M = mapping()
PK = {"io": "importers", "wheel": "mistuning", "reduction": "fem", "fe": "fem", "continuation": "response", "stability": "time_domain",
      "peaks": "response", "problem": "harmonic_balance", "accuracy": "analyses", "effects": "analyses", "design": "analyses", "modes": "analyses",
      "speed": "analyses", "app": "plot"}
SAME = {"util", "model", "contact", "harmonic_balance", "fatigue", "plot"}
def sh(*a): subprocess.run(a, cwd=root, check=True)
tracked = subprocess.run(["git", "ls-files"], cwd=root, capture_output=True, text=True).stdout.split("\n")

EXPORTS = {}
sh("git", "rm", "-qf", "src/bdamper/cli/__main__.py")
for o in {k.split(".")[0] for k in M if "." in k}:
    t = ast.parse((pkg / o / "__init__.py").read_text())
    EXPORTS[o] = {a.asname or a.name for n in ast.walk(t) if isinstance(n, ast.ImportFrom) for a in n.names}
def edit_imports(text, where):
    """New text of a Python file; where: its name for notes."""
    try: tree = ast.parse(text)
    except SyntaxError: return text
    bound = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, (ast.Store, ast.Del))} | {a.arg for a in ast.walk(tree) if isinstance(a, ast.arg)} | {n.name for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.ClassDef))}
    used = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name)}
    other_imports = set()
    edits, rename = [], {}
    lines = text.splitlines(keepends=True)
    starts = [0]
    for l in lines: starts.append(starts[-1] + len(l))
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.level == 0 and (n.module == "bdamper" or (n.module or "").startswith("bdamper."))]
    for n in ast.walk(tree):
        if isinstance(n, (ast.Import, ast.ImportFrom)):
            for a in n.names: other_imports.add(a.asname or a.name)
    for n in imports:
        groups = collections.OrderedDict()
        mod = n.module.removeprefix("bdamper").removeprefix(".")
        for a in n.names:
            full = f"{mod}.{a.name}" if mod else a.name
            if full in M and a.name not in EXPORTS.get(mod, ()):
                new = M[full]; p, _, name = new.rpartition(".")
                target = "bdamper." + p if p else "bdamper"
                asname = a.asname
                if asname is None and name != a.name:
                    if a.name in bound or name in bound | other_imports or (name in used and name not in rename.values()):
                        asname = a.name; print(f"alias kept: {where}: {name} as {a.name}")
                    else: rename[a.name] = name
                if asname == name: asname = None
                groups.setdefault(target, []).append((name, asname))
            else:
                if mod in M: target = "bdamper." + M[mod]
                else:
                    first = mod.split(".")[0]
                    if mod and first not in PK and first not in SAME: print("??", where, mod, a.name)
                    target = "bdamper" + ("." + PK.get(mod, mod) if mod else "")
                groups.setdefault(target, []).append((a.name, a.asname))
        if not groups: continue
        s = starts[n.lineno - 1] + n.col_offset; e = starts[n.end_lineno - 1] + len(lines[n.end_lineno - 1].encode()[: n.end_col_offset].decode())
        indent = " " * n.col_offset
        new = ("\n" + indent).join(f"from {t} import " + ", ".join(x if y is None else f"{x} as {y}" for x, y in v) for t, v in groups.items())
        new = "\n".join(l if len(l) < 125 else re.sub(r"import (.*)$", lambda m: "import (\n" + indent + "    " + m[1] + ",\n" + indent + ")", l) for l in new.split("\n"))
        edits.append((s, e, new))
    for s, e, new in sorted(edits, reverse=True): text = text[:s] + new + text[e:]
    if rename:
        toks = list(tokenize.generate_tokens(io.StringIO(text).readline))
        ls = text.splitlines(keepends=True); out = []
        pos = [0]
        for l in ls: pos.append(pos[-1] + len(l))
        for i, t in enumerate(toks):
            if t.type == tokenize.NAME and t.string in rename and toks[i - 1].string != "." and toks[i + 1].string == "." and not re.match(r"\s*from bdamper", t.line):
                out.append((pos[t.start[0] - 1] + t.start[1], len(t.string), rename[t.string]))
            elif t.type == tokenize.NAME and t.string in rename and toks[i - 1].string != "." and toks[i + 1].string != "=" and not re.match(r"\s*(from|import) ", t.line):
                print("bare use", where, t.start, t.string, t.line.strip()[:90])
                out.append((pos[t.start[0] - 1] + t.start[1], len(t.string), rename[t.string]))
        for t in toks:
            if t.type == tokenize.STRING and re.match(r"[rR]?[fF]", t.string):
                base = pos[t.start[0] - 1] + t.start[1]
                for u in re.finditer(r"(?<=[{(])(" + "|".join(rename) + r")(?=\.)", t.string):
                    out.append((base + u.start(), len(u[0]), rename[u[0]]))
        for s, l, new in sorted(out, reverse=True): text = text[:s] + new + text[s + l:]
    return text

# strings and documents
dotted = sorted(M, key=len, reverse=True)
DOT = {k: v for k, v in M.items()}
D = re.compile(r"\bbdamper\.(" + "|".join(map(re.escape, dotted)) + r")(?![\w])")
P = re.compile(r"\bbdamper/(" + "|".join(re.escape(d.replace(".", "/")) for d in dotted) + r")\.py\b")
K = re.compile(r"\b(bdamper|bd)\.(" + "|".join(sorted(PK, key=len, reverse=True)) + r")(?![\w])")
TK = {**PK, "cli": "command"}
TP = re.compile(r"\btests/(" + "|".join(sorted(TK, key=len, reverse=True)) + r")(?=[/\s:`'\"]|$)")
def edit_text(text):
    def dotted_name(m):
        a, _, b = m[1].rpartition(".")
        return f"bdamper.{PK.get(a, a)}.{b}" if b in EXPORTS.get(a, ()) and not re.match(r"\.\w", m.string[m.end():]) else "bdamper." + M[m[1]]
    text = D.sub(dotted_name, text)
    text = P.sub(lambda m: "bdamper/" + M[m[1].replace("/", ".")].replace(".", "/") + ".py", text)
    text = K.sub(lambda m: m[1] + "." + PK[m[2]], text)
    return TP.sub(lambda m: "tests/" + TK[m[1]], text)

# 1 edit contents
for name in tracked:
    p = root / name
    if not name or not p.is_file() or name.startswith(("CHANGELOG", "docs/images", "tools/rename")) or p.suffix not in {".py", ".md", ".ipynb", ".toml", ".sh", ".rst", ".html", ".pyi", ".txt", "", ".yml", ".c", ".h"}: continue
    try: text = p.read_text(encoding="utf-8")
    except UnicodeDecodeError: continue
    new = edit_imports(text, name) if p.suffix == ".py" else text
    if p.suffix == ".ipynb" or p.suffix == ".md": new = re.sub(r"from bdamper\.(\w+) import", lambda m: "from bdamper." + PK.get(m[1], m[1]) + " import", new)
    new = edit_text(new)
    if new != text: p.write_text(new, encoding="utf-8")
# 2 move package files
packages = {v.split(".")[0] for v in M.values() if "." in v}
for o in sorted({k.split(".")[0] for k in M if "." in k}, key=lambda o: (o not in ("plot", "continuation", "reduction", "io", "wheel", "stability", "design"), o)):  # heads of packages
    head = f"src/bdamper/{o}/__init__.py"
    new = PK.get(o, o)
    if o == "cli": sh("git", "rm", "-qf", head); continue
    if new != o:
        if not (pkg / new / "__init__.py").exists():
            (pkg / new).mkdir(exist_ok=True); sh("git", "mv", head, f"src/bdamper/{new}/__init__.py")
        else:
            sh("git", "rm", "-qf", head)
tmp = [(o, n) for o, n in M.items() if o != n]
for o, n in tmp: sh("git", "mv", "-f", f"src/bdamper/{o.replace('.', '/')}.py", f"src/bdamper/{n.replace('.', '/')}.py.moving")
for o, n in tmp: sh("git", "mv", f"src/bdamper/{n.replace('.', '/')}.py.moving", f"src/bdamper/{n.replace('.', '/')}.py")
for name in tracked:  # other files of packages
    m = re.match(r"src/bdamper/(\w+)/(.+)", name)
    if m and m[1] in PK and not name.endswith(".py") and (root / name).exists(): sh("git", "mv", name, f"src/bdamper/{PK[m[1]]}/{m[2]}")
# 3 tests
for name in tracked:
    m = re.match(r"tests/(\w+)/(.+)", name)
    if m and m[1] in TK and (root / name).exists():
        new = f"tests/{TK[m[1]]}/{m[2]}"
        if (root / new).exists():
            if name.endswith("__init__.py"): sh("git", "rm", "-qf", name); continue
            new = f"tests/{TK[m[1]]}/{m[2].replace('test_', 'test_' + m[1] + '_', 1)}"; print("test renamed", name, new)
        (root / new).parent.mkdir(parents=True, exist_ok=True); sh("git", "mv", name, new)

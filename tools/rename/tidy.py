"""Sort imports, format files that were formatted, reflow long lines of text: tidy.py ROOT BASE"""
import pathlib, subprocess, sys, tempfile, re
root = pathlib.Path(sys.argv[1]); R = str(pathlib.Path(sys.executable).parent / "ruff")
dirs = ["src", "tests", "tools", "benchmarks", "examples"]
subprocess.run([R, "check", "--select", "I", "--fix", "-q", *dirs], cwd=root)
out = subprocess.run([R, "check", "--select", "E501", "--output-format", "concise", *dirs], cwd=root, capture_output=True, text=True).stdout
bad = sorted({l.split(":")[0] for l in out.splitlines() if "E501" in l})
for f in bad:
    subprocess.run([R, "format", "-q", f], cwd=root)
out = subprocess.run([R, "check", "--select", "E501", "--output-format", "concise", *dirs], cwd=root, capture_output=True, text=True).stdout
for f in sorted({l.split(":")[0] for l in out.splitlines() if "E501" in l}):
    text = (root / f).read_text(); lines = text.split("\n"); i = 0
    import ast
    doc = {i for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant) and isinstance(n.value.value, str) for i in range(n.lineno - 1, n.end_lineno)}
    doc = {lines[i] for i in doc} | {l for l in lines if l.strip().startswith("# ")}
    while i < len(lines):
        l = lines[i]
        if len(l) > 124 and l in doc:
            cut = l.rfind(" ", 0, 124); ind = re.match(r"\s*(# )?", l)[0]
            rest = l[cut + 1:]; lines[i] = l[:cut].rstrip(); doc.add(lines[i])
            nxt = lines[i + 1] if i + 1 < len(lines) else ""
            same = nxt.startswith(ind) and nxt.strip() and not nxt[len(ind):].startswith((" ", "-", "*", '"""', ">>>", "#"))
            if same and not l.rstrip().endswith('"""') and nxt.strip() != '"""': lines[i + 1] = ind + rest + " " + nxt[len(ind):]; doc.add(lines[i + 1])
            else: lines.insert(i + 1, ind + rest)
        i += 1
    (root / f).write_text("\n".join(lines))
print(subprocess.run([R, "check", *dirs, "--output-format", "concise"], cwd=root, capture_output=True, text=True).stdout)

"""The Python of the README by the installed package, away from its sources: ``python run_readme.py README.md``."""

import re
import sys
from pathlib import Path

blocks = re.findall(r"```python\n(.*?)```", Path(sys.argv[1]).read_text(encoding="utf-8"), re.S)
assert blocks, "the README shows no code"
exec(compile("\n".join(blocks), sys.argv[1], "exec"), {"__name__": "readme"})
print(f"{len(blocks)} blocks of the README ran")

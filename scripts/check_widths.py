#!/usr/bin/env python3
"""Comments and prose are at most 130 columns wide. Tables, links and code are as wide as they are."""
import pathlib
import re
import subprocess
import sys

WIDTH = 130

root = pathlib.Path(__file__).resolve().parent.parent
files = subprocess.run(["git", "ls-files"], cwd=root, check=True, capture_output=True, text=True).stdout.split()
wide = []
for name in files:
    comment = {".rs": "//", ".wgsl": "//", ".md": "", ".sh": "#", ".py": "#"}.get(pathlib.Path(name).suffix)
    path = root / name
    if comment is None or not path.exists():
        continue
    is_code = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        text = line.strip()
        prose = re.sub(r"^(//[/!]?|#)\s*", "", text)
        if prose.startswith("```"):
            is_code = not is_code
        elif len(line) > WIDTH and text.startswith(comment) and not is_code and not re.search(r"https?:|^[|!]", prose):
            wide.append(f"{name}:{number}: {len(line)} columns")
print("\n".join(wide) or f"No comment or prose is wider than {WIDTH} columns.")
sys.exit(bool(wide))

#!/usr/bin/env python3
"""Asks a browser for its verdict on every WGSL shader of a folder.

naga, wgpu's shader compiler, accepts programs that the browsers' compilers reject: a barrier or a subgroup operation in
non-uniform control flow, for one. So this serves the shaders on loopback to a headless Chromium, which has Tint, and has it

  1. compile each module (createShaderModule, getCompilationInfo), and
  2. build a compute pipeline with an automatic layout from each of its compute entry points,

each on a WebGPU device of its own that has the default limits, the floor that every browser offers.

A shader may say what it needs in comments on its first lines:

  // requires: subgroups          the device feature, and the `enable` directive which naga does not want written
  // constant: NAME = 64          a value for an `override` that has no default

Prints a line per shader and closes with `N passed, N failed`. Exit 1: one failed, there was none, or the browser gave no answer.
"""

import json
import pathlib
import re
import sys

import browser

# What `// requires:` may name: the device feature, and the WGSL extension to enable (None: there is none).
FEATURES = {"subgroups": "subgroups"}

PAGE = r"""<!doctype html><meta charset="utf-8"><title>shader check</title><script type="module">
const post = (path, value) => fetch(path, { method: 'POST', body: JSON.stringify(value) });

// What is wrong with one shader: a list of messages, empty for a good one. A device per shader, so that a device lost to one
// shader leaves the others alone, and so that no shader sees a feature that it did not ask for.
async function check(shader) {
  const adapter = await navigator.gpu.requestAdapter();
  if (!adapter) return ['no WebGPU adapter'];
  const missing = shader.features.filter((feature) => !adapter.features.has(feature));
  if (missing.length > 0) return [`the adapter lacks ${missing.join(', ')}; it has ${[...adapter.features].sort().join(', ')}`];
  const device = await adapter.requestDevice({ requiredFeatures: shader.features });
  const problems = [];
  device.addEventListener('uncapturederror', (event) => problems.push(event.error.message));

  device.pushErrorScope('validation');
  const module = device.createShaderModule({ label: shader.name, code: shader.code });
  const { messages } = await module.getCompilationInfo();
  const moduleError = await device.popErrorScope();
  for (const { type, message, lineNum, linePos } of messages) {
    if (type === 'error') problems.push(`${lineNum}:${linePos}: ${message}`);
    if (type === 'warning') await post('/note', `${shader.name}:${lineNum}:${linePos}: warning: ${message}`);
  }
  if (moduleError && problems.length === 0) problems.push(moduleError.message);

  if (problems.length === 0) {
    for (const entryPoint of shader.entryPoints) {
      device.pushErrorScope('validation');
      device.pushErrorScope('internal');
      try {
        await device.createComputePipelineAsync({
          label: `${shader.name} ${entryPoint}`,
          layout: 'auto',
          compute: { module, entryPoint, constants: shader.constants },
        });
      } catch (error) {
        problems.push(`${entryPoint}: ${error.message}`);
      }
      for (const error of [await device.popErrorScope(), await device.popErrorScope()]) {
        if (error) problems.push(`${entryPoint}: ${error.message}`);
      }
    }
  }
  device.destroy();
  return problems;
}

try {
  if (!navigator.gpu) throw new Error('this browser has no WebGPU');
  const { vendor, architecture, description } = (await navigator.gpu.requestAdapter())?.info ?? {};
  if (vendor === undefined) throw new Error('no WebGPU adapter');
  await post('/note', `adapter: ${[vendor, architecture, description].filter(Boolean).join(' ')}`);
  const shaders = await (await fetch('/shaders')).json();
  // Pipelines are made on threads of the browser's own: some at a time keep them busy.
  const work = async () => {
    for (let shader = shaders.shift(); shader; shader = shaders.shift()) {
      const problems = await check(shader).catch((error) => [String(error)]);
      await post('/verdict', { name: shader.name, problems });
    }
  };
  await Promise.all([work(), work(), work()]);
  await post('/end', null);
} catch (error) {
  await post('/end', String(error));
}
</script>"""


class Shader:
    """A file of WGSL, and what a browser must be told about it."""

    def __init__(self, name, text):
        self.name = name
        self.features, self.constants, self.mistakes = [], {}, []
        for line in text.splitlines():
            if not line.startswith("//"):
                break
            if found := re.match(r"//\s*requires:(.*)", line):
                self.features += [word for word in re.split(r"[\s,]+", found[1]) if word]
            elif found := re.match(r"//\s*constant:\s*(\w+)\s*=\s*(\S+)\s*$", line):
                try:
                    self.constants[found[1]] = float(found[2])
                except ValueError:
                    self.mistakes.append(f"`constant: {found[1]}` is not a plain number: {found[2]}")
        self.mistakes += [f"`requires: {f}` is not known here: add it to FEATURES" for f in self.features if f not in FEATURES]
        enabled = [FEATURES[f] for f in self.features if FEATURES.get(f)]
        # Before the first line, on that same line: the line numbers in messages stay those of the file.
        self.code = "".join(f"enable {extension}; " for extension in enabled) + text
        self.entry_points = compute_entry_points(text)

    def for_browser(self):
        return {
            "name": self.name,
            "code": self.code,
            "features": self.features,
            "constants": self.constants,
            "entryPoints": self.entry_points,
        }


def compute_entry_points(text):
    """The names of the functions that have the attribute @compute, wherever it stands among their attributes."""
    text = re.sub(r"//[^\n]*", "", text)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    names = []
    for function in re.finditer(r"\bfn\s+(\w+)", text):
        # Attributes stand between the end of the declaration before and the `fn`.
        start = max(text.rfind("}", 0, function.start()), text.rfind(";", 0, function.start())) + 1
        if re.search(r"@\s*compute\b", text[start : function.start()]):
            names.append(function[1])
    return names


class Check:
    """Answers the page, and gathers the verdicts: each shader's list of problems by name."""

    def __init__(self, shaders):
        self.shaders = shaders
        self.verdicts = {}

    def __call__(self, path, body):
        if path == "/":
            return "text/html; charset=utf-8", PAGE.encode()
        if path == "/shaders":
            return "application/json", json.dumps([shader.for_browser() for shader in self.shaders]).encode()
        if path == "/verdict":
            value = json.loads(body)
            self.verdicts[value["name"]] = value["problems"]
            return "text/plain", b""
        return None


def main():
    parser = browser.arguments(__doc__)
    parser.add_argument("folder", nargs="?", default="target/wgsl", type=pathlib.Path, help="default: %(default)s")
    options = parser.parse_args()

    files = sorted(options.folder.rglob("*.wgsl"))
    if not files:
        parser.exit(1, f"no .wgsl file in {options.folder}: the tests write them there\n")
    shaders = [Shader(str(file.relative_to(options.folder)), file.read_text()) for file in files]

    check = Check([s for s in shaders if not s.mistakes])
    trouble = browser.visit(options.browser, check, options.timeout)

    failed = 0
    for shader in shaders:
        problems = shader.mistakes or check.verdicts.get(shader.name, [trouble or "no verdict"])
        count = len(shader.entry_points)
        pipelines = f"{count} compute pipeline{'' if count == 1 else 's'}" if count else "module only"
        print(f"{'FAILED' if problems else 'ok':6} {shader.name} ({pipelines})")
        for problem in problems:
            print("       " + problem.strip().replace("\n", "\n       "))
        failed += bool(problems)
    if trouble:
        print(f"the browser: {trouble}")
    print(f"{len(shaders) - failed} passed, {failed} failed")
    sys.exit(1 if failed or trouble else 0)


if __name__ == "__main__":
    main()

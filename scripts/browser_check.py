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

import argparse
import http.server
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

# What `// requires:` may name: the device feature, and the WGSL extension to enable (None: there is none).
FEATURES = {"subgroups": "subgroups"}

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM_FLAGS = (
    "--headless",
    "--no-sandbox",  # the only page is ours, and the sandbox needs what a container may not allow
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",  # a software driver: the verdict does not depend on the machine
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    # Nothing leaves this machine.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-domain-reliability",
    "--disable-quic",
    "--disable-sync",
    "--no-default-browser-check",
    "--no-first-run",
    "--no-pings",
    "--no-proxy-server",
    "--disable-dev-shm-usage",
)

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


class Check(http.server.ThreadingHTTPServer):
    """Serves the page and the shaders on a free port of loopback, and gathers the verdicts."""

    daemon_threads = True

    def __init__(self, shaders):
        super().__init__(("127.0.0.1", 0), Handler)
        self.shaders = shaders
        self.verdicts = {}
        self.trouble = None
        self.ended = threading.Event()


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        if self.path == "/":
            self.answer("text/html; charset=utf-8", PAGE)
        elif self.path == "/shaders":
            self.answer("application/json", json.dumps([shader.for_browser() for shader in self.server.shaders]))
        else:
            self.send_error(404)

    def do_POST(self):
        value = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        if self.path == "/verdict":
            self.server.verdicts[value["name"]] = value["problems"]
        elif self.path == "/note":
            print(value, flush=True)
        elif self.path == "/end":
            self.server.trouble = value
        self.answer("text/plain", "")
        if self.path == "/end":
            self.server.ended.set()

    def answer(self, kind, body):
        body = body.encode()
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def ask_browser(browser, shaders, seconds):
    """Each shader's list of problems by name (a shader without an answer is left out), and what went wrong with the browser."""
    server = Check(shaders)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    scratch = tempfile.mkdtemp(prefix="browser-check-")  # the profile, and whatever else the browser lays down
    log = tempfile.TemporaryFile("w+", errors="replace")
    page = f"http://127.0.0.1:{server.server_port}/"
    command = [browser, *CHROMIUM_FLAGS, f"--user-data-dir={scratch}/profile", page]
    chromium = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        env=os.environ | {"TMPDIR": scratch},
        start_new_session=True,
    )
    try:
        deadline = time.monotonic() + seconds
        while not server.ended.wait(0.2):
            if chromium.poll() is not None:
                server.trouble = f"the browser ended early (status {chromium.returncode})"
                break
            if time.monotonic() > deadline:
                server.trouble = f"no answer within {seconds:g} s"
                break
    finally:
        stop(chromium)
        server.shutdown()
        server.server_close()
        shutil.rmtree(scratch, ignore_errors=True)
    if server.trouble:
        log.seek(0)
        print("".join(log.readlines()[-20:]), end="", file=sys.stderr)
    return server.verdicts, server.trouble


def stop(chromium):
    """Ends the browser: itself first, so that it ends its own processes, then whatever it left."""
    chromium.terminate()
    try:
        chromium.wait(10)
    except subprocess.TimeoutExpired:
        pass
    try:
        os.killpg(chromium.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    chromium.wait()


def main():
    # Told to stop, unwind as usual: the browser is in a session of its own, and would be left behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default="target/wgsl", type=pathlib.Path, help="default: %(default)s")
    parser.add_argument("--browser", help=f"the program to run (default: the first of {', '.join(CHROMIUM_NAMES)} on the PATH)")
    parser.add_argument("--timeout", type=float, default=600.0, metavar="S", help="for all shaders together (default: %(default)g s)")
    options = parser.parse_args()

    browser = options.browser or next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)
    if browser is None:
        parser.exit(1, f"no browser on the PATH: install one of {', '.join(CHROMIUM_NAMES)}\n")
    files = sorted(options.folder.rglob("*.wgsl"))
    if not files:
        parser.exit(1, f"no .wgsl file in {options.folder}: the tests write them there\n")
    shaders = [Shader(str(file.relative_to(options.folder)), file.read_text()) for file in files]

    verdicts, trouble = ask_browser(browser, [s for s in shaders if not s.mistakes], options.timeout)

    failed = 0
    for shader in shaders:
        problems = shader.mistakes or verdicts.get(shader.name, [trouble or "no verdict"])
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

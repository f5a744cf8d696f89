#!/usr/bin/env python3
"""Compares the pictures of examples/web in a browser with those that were rendered without one.

The folder of the page is what `scripts/web.sh` builds. The other has a folder for each driver that `tests/whole/browser.rs` ran
on, with the same pictures. Read back from buffers, the browser's may differ from them in two numbers: how far a texel may be
off, and how many texels may be farther.

Prints a line for each picture and driver, the size of the download, and the time of a frame on the page itself.
Exit 1: a picture differs, there was none to compare with, or the browser gave no answer.
"""

import gzip
import json
import pathlib
import struct
import sys

import browser

# Of each effect how far a texel's channel may be off, as a share of the picture's mean, and the share of texels that may be
# farther.
#
# Drivers round differently. A ray that passes an edge by less than that meets something else: one of the 4 rays of a pixel moves
# its visibility by a quarter, one of 8 its light by that ray's, and the filter spreads either over the pixels around. So it is
# along edges, and most in the corners below the lamp, where light is many times the mean. Lavapipe and SwiftShader without a
# browser have 1.0 % and 3.0 % of such texels between them.
EFFECTS = {"occlusion": (0.02, 0.02), "light": (0.1, 0.05)}

# The browser's own driver, of which its pictures have the same bits: what is left for a browser that compiles otherwise than
# naga, and so rounds otherwise, is a tenth of those texels.
OWN_DRIVER = "swiftshader"
OF_OWN_DRIVER = 0.1

KINDS = {".html": "text/html; charset=utf-8", ".js": "text/javascript", ".wasm": "application/wasm"}

PAGE = r"""<!doctype html><meta charset="utf-8"><title>pictures</title>
<canvas id="canvas" width="192" height="128"></canvas>
<script type="module">
const post = (path, value) => fetch(path, { method: 'POST', body: JSON.stringify(value) });
addEventListener('unhandledrejection', (event) => post('/end', String(event.reason)));
addEventListener('error', (event) => post('/end', event.message));
const report = console.error;
console.error = (text) => { report(text); post('/end', String(text)); };
try {
  if (!navigator.gpu) throw new Error('this browser has no WebGPU');
  const { default: init, Page, picture } = await import('./web.js');
  await init();
  for (const effect of EFFECTS) {
    const start = performance.now();
    await fetch(`/picture/${effect}`, { method: 'POST', body: await picture(effect) });
    await post('/note', `${effect}: pipelines and a picture in ${((performance.now() - start) / 1e3).toFixed(1)} s`);
  }
  // The page's own frames: the first compiles, so the second is timed.
  const page = await Page.open(document.getElementById('canvas'), 'cornell', 'occlusion', 'fast');
  for (let frame = 0; frame < 2; frame++) {
    const start = performance.now();
    page.turn(0.1, 0.0);
    page.draw();
    await page.done();
    if (frame > 0) await post('/note', `192x128, fast occlusion: a frame in ${(performance.now() - start).toFixed(0)} ms`);
  }
  await post('/end', null);
} catch (error) {
  await post('/end', String(error));
}
</script>""".replace("EFFECTS", json.dumps(list(EFFECTS)), 1)


class Visit:
    """Answers the page, and gathers the pictures by effect."""

    def __init__(self, folder):
        self.folder = folder
        self.pictures = {}

    def __call__(self, path, body):
        if path == "/":
            return "text/html; charset=utf-8", PAGE.encode()
        if path.startswith("/picture/"):
            self.pictures[path.removeprefix("/picture/")] = body
            return "text/plain", b""
        file = self.folder / path.removeprefix("/")
        if file.suffix in KINDS and file.parent == self.folder and file.is_file():
            return KINDS[file.suffix], file.read_bytes()
        return None


def texels(data):
    """Texels of three channels; the fourth says nothing."""
    values = struct.unpack(f"<{len(data) // 2}e", data)
    return [values[i : i + 3] for i in range(0, len(values), 4)]


def compare(ours, other, near):
    """The share of texels that are farther off than that of the mean, the farthest, and the mean, in the picture's unit."""
    mean = sum(map(sum, other)) / (3 * len(other))
    differences = [max(abs(a - b) for a, b in zip(p, q)) for p, q in zip(ours, other)]
    # What is not a number is not within any distance.
    far = sum(not d <= near * mean for d in differences)
    return far / len(other), max(differences), mean


def main():
    parser = browser.arguments(__doc__)
    parser.add_argument("page", nargs="?", default="target/web/page", type=pathlib.Path, help="default: %(default)s")
    parser.add_argument("native", nargs="?", default="target/web/native", type=pathlib.Path, help="default: %(default)s")
    options = parser.parse_args()

    # Those that the test has ended on.
    drivers = sorted(f for f in options.native.glob("*") if all((f / f"{effect}.f16").is_file() for effect in EFFECTS))
    if not drivers:
        parser.exit(1, f"no pictures in {options.native}: cargo test --test whole browser writes them there\n")
    visit = Visit(options.page)
    trouble = browser.visit(options.browser, visit, options.timeout)

    failed = bool(trouble)
    for driver in drivers:
        for effect, (near, allowed) in EFFECTS.items():
            ours = visit.pictures.get(effect, b"")
            other = (driver / f"{effect}.f16").read_bytes()
            what = f"{effect} beside {driver.name}"
            if not ours or len(ours) != len(other):
                print(f"FAILED {what}: {len(ours)} bytes from the browser, {len(other)} from the driver")
                failed = True
                continue
            if driver.name == OWN_DRIVER:
                allowed *= OF_OWN_DRIVER
            far, farthest, mean = compare(texels(ours), texels(other), near)
            good = far <= allowed and mean > 0.0
            print(
                f"{'ok' if good else 'FAILED':6} {what}: {far:.2%} of texels are off by more than {near:.0%} of the mean"
                f" {mean:.3f}, at most {farthest:.5f}"
            )
            failed = failed or not good
    for name in ("web_bg.wasm", "web.js", "index.html"):
        data = (options.page / name).read_bytes()
        print(f"{name}: {len(data) / 1e3:.0f} kB, {len(gzip.compress(data, 9)) / 1e3:.0f} kB with gzip")
    if trouble:
        print(f"the browser: {trouble}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()

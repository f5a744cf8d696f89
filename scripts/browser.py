"""A headless Chromium, and the page that it is shown: what the checks in a browser share."""

import argparse
import http.server
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM_FLAGS = (
    "--headless",
    "--no-sandbox",  # the only page is ours, and the sandbox needs what a container may not allow
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",  # a software driver: the verdict does not depend on the machine
    "--enable-features=Vulkan",
    "--use-vulkan=swiftshader",
    "--use-angle=swiftshader",  # what brings a canvas's picture to the page
    "--enable-unsafe-swiftshader",
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


class Server(http.server.ThreadingHTTPServer):
    """Answers a page on a free port of loopback, until that says that it has ended."""

    daemon_threads = True

    def __init__(self, answers):
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers = answers
        self.trouble = None
        self.ended = threading.Event()


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.answer(None)

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        if self.path == "/note":
            print(json.loads(body), flush=True)
        elif self.path == "/end":
            self.server.trouble = json.loads(body)
        else:
            self.answer(body)
            return
        self.send("text/plain", b"")
        if self.path == "/end":
            self.server.ended.set()

    def answer(self, body):
        answer = self.server.answers(self.path, body)
        if answer is None:
            self.send_error(404)
        else:
            self.send(*answer)

    def send(self, kind, body):
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def visit(browser, answers, seconds):
    """Shows the page at / to a browser. Returns what went wrong, None for nothing.

    `answers(path, body)` is the kind and the bytes of what is at a path, or None; the body is None for what is not posted. The
    page posts JSON to /note to have it printed, and to /end, null or what went wrong, when it has ended.
    """
    # Told to stop, unwind as usual: the browser is in a session of its own, and would be left behind.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    server = Server(answers)
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
    return server.trouble


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


def arguments(description):
    """A parser of what the checks have in common: `browser` and `timeout`."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    found = next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)
    parser.add_argument(
        "--browser",
        default=found,
        required=found is None,
        help=f"the program to run (default: the first of {', '.join(CHROMIUM_NAMES)} on the PATH)",
    )
    parser.add_argument("--timeout", type=float, default=600.0, metavar="S", help="for all together (default: %(default)g s)")
    return parser

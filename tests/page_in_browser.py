"""Pages opened from disk in headless Chromium, as by a double click, and a script that looks.

Chromium is that of the environment variable CHROMIUM, else one on the path. A graphics card is not
needed: it draws in software.
"""

import contextlib
import json
import subprocess
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from check_site import browser_command, find_browser

from medialis.show.viewer.page import frame, has_library

PATIENCE = 120
"""Seconds until a browser that says nothing is given up."""

NARROWEST = 500
"""Pixels of a window of Chromium; narrower pages are looked at in a frame."""

RECORDER = """<script>window.seen = [];
for (const name of ["error", "warn"])
  console[name] = (...all) => seen.push(name + ": " + all.join(" "));
addEventListener("error", event => seen.push("script: " + event.message));
addEventListener("unhandledrejection", event => seen.push("promise: " + event.reason));
</script>"""

LOOKER = """<script>(async () => {
let found = {};
try {
  const {viewer, panel} = await medialisViewer.ready.catch(FAILED);
  const $ = id => document.getElementById(id);
  const set = (id, value) => { $(id).value = value; $(id).dispatchEvent(new Event("input")); };
  const differ = (a, b) => a.reduce((sum, x, i) => sum + (x !== b[i]), 0) / a.length;
  found = await (async () => { SCRIPT })();
} catch (error) { seen.push(String(error && error.stack || error)); }
fetch("http://127.0.0.1:PORT/", {method: "POST", mode: "no-cors",
  body: JSON.stringify({found, seen})});
})();</script>"""


def need_viewer() -> str:
    """Return the browser; skip the test where there is none, or no library to draw with."""
    if not has_library():
        pytest.skip("the library of the viewer is not built (make viewer)")
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium found (CHROMIUM names one)")
    return browser


def looked_at(
    page: Path, script: str, size: tuple[int, int] = (1000, 700), *, webgl: bool = True
) -> dict:
    """Return what a script finds in a page; fail on anything that the page logs as an error.

    Without WebGL there is no `viewer` and no `panel`.
    """
    browser, done, said = need_viewer(), threading.Event(), []

    class Ear(BaseHTTPRequestHandler):
        def do_POST(self):
            said.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            done.set()

        def log_message(self, *arguments):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Ear)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    text = page.read_text(encoding="utf-8").replace("<head>", f"<head>{RECORDER}", 1)
    looker = LOOKER.replace("SCRIPT", script).replace("PORT", str(server.server_address[1]))
    looker = looker.replace("FAILED", f"error => {'{ throw error; }' if webgl else '({})'}")
    watched = page.with_name(f"watched-{page.name}")
    text = text.replace("</body></html>", f"{looker}</body></html>")
    if size[0] < NARROWEST:
        text = f'<body style="margin:0"><div style="width:{size[0]}px">{frame(text, size[1])}</div>'
    watched.write_text(text, encoding="utf-8")
    window = f"--window-size={max(size[0], NARROWEST)},{size[1] + 100}"
    options = (window, "--remote-debugging-port=0", *(() if webgl else ("--disable-3d-apis",)))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [*browser_command(browser, profile, *options), watched.resolve().as_uri()],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            done.wait(PATIENCE)
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
            server.shutdown()
            server.server_close()
    assert said, f"{browser} has not reported within {PATIENCE} s"
    assert said[0]["seen"] == []
    return said[0]["found"]

"""Look at the built site in headless Chromium, every page on a narrow and on a wide screen.

python docs/check_site.py [FOLDER] [--screenshots FOLDER PAGE ...]

On each page: no picture is broken, nothing is wider than the screen, nothing is logged as an error,
no link leads nowhere. One Chromium does it: a page of ours, served on loopback, opens every page in
a frame of the wanted width and sends back what it saw.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

DOCS = Path(__file__).resolve().parent
WIDTHS = (390, 1280)
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE = 300
"""Seconds until a browser that says nothing is given up."""

RECORDER = b"""<script>window.seen = [];
console.error = (...all) => seen.push("console: " + all.join(" "));
addEventListener("error", e => { if (e.message) seen.push("script: " + e.message); });
addEventListener("unhandledrejection", e => seen.push("script: " + e.reason));
</script>"""

INSPECTOR = """<!doctype html><title>check</title><body style="margin:0"><script>
const settle = ms => new Promise(done => setTimeout(done, ms));
async function look(page, width) {
  const frame = document.createElement("iframe");
  Object.assign(frame.style, {width: width + "px", height: "900px", border: "0"});
  const loaded = new Promise(done => frame.onload = done);
  frame.src = page;
  document.body.append(frame);
  await loaded;
  const inside = frame.contentWindow, d = inside.document;
  for (const image of d.images) image.loading = "eager";
  await Promise.all([...d.images].map(image => image.decode().catch(() => 0)));
  await settle(20);
  const found = [...inside.seen ?? ["the page has no recorder"]];
  for (const image of d.images)
    if (!image.naturalWidth) found.push("broken picture " + image.getAttribute("src"));
  if (d.scrollingElement.scrollWidth > width) {
    // What sticks out, unless a parent scrolls or cuts it off.
    const out = [...d.body.querySelectorAll("*")].filter(e =>
      e.getBoundingClientRect().right > width + 1 && e.getClientRects().length);
    const name = e => e.tagName.toLowerCase() + "." + e.className;
    found.push(`wider than ${width}: ${d.scrollingElement.scrollWidth}, ` +
               out.slice(-3).map(name).join(", "));
  }
  if (!d.querySelector("h1")) found.push("no title");
  frame.remove();
  return found.map(text => ({page, width, text}));
}
(async () => {
  const {pages, widths} = await (await fetch("/tasks")).json();
  const all = [];
  for (const page of pages)
    for (const width of widths)
      try { all.push(...await look(page, width)); }
      catch (e) { all.push({page, width, text: String(e)}); }
  await fetch("/report", {method: "POST", body: JSON.stringify(all)});
})();
</script>"""

FRAME = """<!doctype html><body style="margin:0"><iframe src="/{page}" style="border:0;
width:{width}px;height:100vh"></iframe>"""


def find_browser() -> str | None:
    """Return the path of Chromium or Chrome, None where there is none."""
    named = os.environ.get("CHROMIUM")
    return shutil.which(named) if named else next(filter(None, map(shutil.which, PROGRAMS)), None)


class _Links(HTMLParser):
    """All addresses that a page names, and all anchors that it has."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note one element."""
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.targets.append(value)
            if value and name in ("id", "name"):
                self.anchors.add(value)


def broken_links(site: Path) -> list[str]:
    """Return a line for every link, picture or anchor inside the site that is not there."""
    pages = {}
    for path in sorted(site.rglob("*.html")):
        pages[path.resolve()] = _Links()
        pages[path.resolve()].feed(path.read_text(encoding="utf-8"))
    found = []
    for path, page in pages.items():
        for target in page.targets:
            address, anchor = urldefrag(target)
            if urlsplit(address).scheme or address.startswith("//"):
                continue
            file = (path.parent / unquote(urlsplit(address).path)).resolve() if address else path
            where = path.relative_to(site.resolve())
            if not file.is_file():
                found.append(f"{where}: nothing at {target}")
            elif anchor and file in pages and unquote(anchor) not in pages[file].anchors:
                found.append(f"{where}: no anchor {target}")
    return found


class _Site(SimpleHTTPRequestHandler):
    """The site on loopback, with the inspector; every page records what goes wrong in it."""

    server: _Server

    def do_GET(self) -> None:
        """Serve a page, or one of ours."""
        path = self.path.partition("?")[0]
        if path == "/inspector":
            return self._send(INSPECTOR.encode(), "text/html")
        if path == "/tasks":
            tasks = {"pages": self.server.pages, "widths": WIDTHS}
            return self._send(json.dumps(tasks).encode(), "application/json")
        if path.startswith("/frame/"):
            _, _, width, page = path.split("/", 3)
            return self._send(FRAME.format(width=width, page=page).encode(), "text/html")
        if path == "/favicon.ico":
            return self._send(b"", "image/x-icon")
        file = Path(self.translate_path(path))
        if file.suffix == ".html" and file.is_file():
            text = file.read_bytes()
            return self._send(text.replace(b"<head>", b"<head>" + RECORDER, 1), "text/html")
        return super().do_GET()

    def do_POST(self) -> None:
        """Take the report of the inspector."""
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.report = json.loads(body)
        self._send(b"", "text/plain")
        self.server.done.set()

    def _send(self, body: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        """Say nothing."""


class _Server(ThreadingHTTPServer):
    """The server with what it has to hand out and to collect."""

    def __init__(self, site: Path) -> None:
        super().__init__(("127.0.0.1", 0), partial(_Site, directory=str(site)))
        self.pages = [
            "/" + path.relative_to(site).as_posix()
            for path in sorted(site.rglob("*.html"))
            if path.name not in ("search.html",)
        ]
        self.report: list[dict[str, object]] | None = None
        self.done = threading.Event()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def address(self, path: str) -> str:
        """Return the full address of a path."""
        return f"http://127.0.0.1:{self.server_address[1]}/{path}"


def browser_command(browser: str, profile: str, *options: str) -> list[str]:
    """Return the command of a headless browser that draws in three dimensions without a card."""
    fixed = ["--headless=new", "--no-first-run", "--hide-scrollbars"]
    fixed += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:  # Chromium's sandbox refuses root
        fixed.append("--no-sandbox")
    return [browser, *fixed, f"--user-data-dir={profile}", *options]


def look(site: Path, browser: str) -> list[str]:
    """Return a line for everything that is wrong on any page in a real browser."""
    server = _Server(site)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = browser_command(browser, profile, "--remote-debugging-port=0")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([*command, server.address("inspector")], **quiet)
        try:
            server.done.wait(PATIENCE)
        finally:
            process.terminate()
            process.wait()
            server.shutdown()
            server.server_close()
    if server.report is None:
        return [f"{browser} has not reported within {PATIENCE} s."]
    return [f"{row['page']} at {row['width']}: {row['text']}" for row in server.report]


def screenshots(site: Path, browser: str, folder: Path, pages: list[str]) -> None:
    """Save a picture of every named page at both widths."""
    server = _Server(site)
    folder.mkdir(parents=True, exist_ok=True)
    for page in pages:
        for width in WIDTHS:
            out = folder / f"{Path(page).with_suffix('').as_posix().replace('/', '-')}-{width}.png"
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
                size = f"--window-size={max(width, 500)},1600"
                options = (size, f"--screenshot={out}", "--virtual-time-budget=4000")
                command = browser_command(browser, profile, *options)
                address = server.address(f"frame/{width}/{page}")
                subprocess.run([*command, address], check=True, capture_output=True)
            print(out)
    server.shutdown()
    server.server_close()


def check(site: Path) -> int:
    """Check the built site, print what is wrong, and return the exit code."""
    found = broken_links(site)
    browser = find_browser()
    if browser is None:
        print("Left out: no Chromium found to look at the pages (CHROMIUM names one).")
    else:
        found += look(site, browser)
    for line in found:
        print(line)
    count = len(list(site.rglob("*.html")))
    print(f"{count} pages checked, {len(found)} faults.")
    return 1 if found or not count else 0


def main(arguments: list[str]) -> int:
    """Check a site, or save screenshots of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("site", type=Path, nargs="?", default=DOCS.parent / "build" / "site")
    parser.add_argument("--screenshots", nargs="+", metavar=("FOLDER", "PAGE"))
    given = parser.parse_args(arguments)
    if not given.screenshots:
        return check(given.site)
    browser = find_browser()
    if browser is None:
        print("No Chromium found (CHROMIUM names one).")
        return 1
    folder, *pages = given.screenshots
    screenshots(given.site, browser, Path(folder), pages or ["index.html"])
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

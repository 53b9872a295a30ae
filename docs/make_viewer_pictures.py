"""Pictures of the viewer in headless Chromium, on a wide screen and on a phone.

python docs/make_viewer_pictures.py    (needs Chromium, which CHROMIUM names, and `make viewer`)
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from check_site import browser_command, find_browser

import medialis
from medialis.show.viewer.page import frame

PICTURES = Path(__file__).resolve().parent / "pictures"
PICK = """<script>medialisViewer.ready.then(({viewer, panel}) => {
const part = viewer.parts.find(part => part.kind === "points");
const field = part.fields.find(field => field.name === "importance");
let row = 0;
for (let i = 0; i < part.count; i++)
  if (field.values[i] <= 1 && field.values[i] > field.values[row]) row = i;
viewer.drawNow();
panel.pick(...viewer.onScreen([...part.points.slice(3 * row, 3 * row + 3)]));
});</script>"""
SECTION = """<script>medialisViewer.ready.then(({viewer, panel}) => {
document.getElementById("cutbutton").click();
document.getElementById("axis").value = "view";
panel.section();
});</script>"""
NARROWEST = 500
"""Pixels of a window of Chromium."""


def shoot(text: str, script: str, name: str, width: int, height: int) -> None:
    """Save a picture of a page after a script has run in it."""
    browser = find_browser()
    if browser is None:
        raise SystemExit("No Chromium found (CHROMIUM names one).")
    text = text.replace("</body></html>", f"{script}</body></html>")
    if width < NARROWEST:
        text = f'<body style="margin:0"><div style="width:{width}px">{frame(text, height)}</div>'
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        page, out = Path(folder) / "page.html", PICTURES / f"{name}.png"
        page.write_text(text, encoding="utf-8")
        size = f"--window-size={max(width, NARROWEST)},{height}"
        options = (size, f"--screenshot={out}", "--virtual-time-budget=6000")
        command = browser_command(browser, f"{folder}/profile", *options)
        subprocess.run([*command, page.as_uri()], check=True, capture_output=True)
    print(out)


def main() -> int:
    """Make both pictures."""
    shape = medialis.organic_shape(220)
    skeleton, thickness = (medialis.run(n, shape) for n in ("surface_skeleton", "thickness"))
    with tempfile.TemporaryDirectory() as folder:
        pages = {}
        for name, results in (("skeleton", (skeleton, thickness)), ("thickness", (thickness,))):
            results[0].viewer_html(f"{folder}/{name}.html", *results[1:], title="creature.ply")
            pages[name] = Path(folder, f"{name}.html").read_text("utf-8")
    shoot(pages["skeleton"], PICK, "viewer", 1280, 800)
    shoot(pages["thickness"], SECTION, "viewer_section", 1280, 800)
    return 0


if __name__ == "__main__":
    sys.exit(main())

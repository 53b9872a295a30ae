// Start when the page is there; `medialisViewer.ready` tells scripts when, and that it works.
"use strict";

async function start() {
  const text = id => document.getElementById(id).textContent;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  document.documentElement.dataset.theme = dark.matches ? "dark" : "light";
  if (innerWidth < NARROW) document.body.classList.add("closed");
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await inflated(text("library")));
  document.head.append(script);
  const bytes = await inflated(text("arrays"));
  const viewer = new Viewer(JSON.parse(text("scene")), bytes, document.getElementById("canvas"));
  const panel = new Panel(viewer);
  dark.addEventListener("change", () => panel.setTheme(dark.matches ? "dark" : "light"));
  viewer.drawNow();
  document.body.dataset.state = "ready";
  return {viewer, panel};
}

window.medialisViewer = {ready: start()};
window.medialisViewer.ready.catch(error => {
  document.body.dataset.state = "failed";
  const why = typeof DecompressionStream === "undefined" ? "this browser is too old"
    : document.createElement("canvas").getContext("webgl2") ? String(error) : "this browser shows no WebGL";
  document.getElementById("failed").textContent = `The shape cannot be shown: ${why}.`;
  console.error(error);
});

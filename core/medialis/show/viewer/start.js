// Start when the page is there; `medialisViewer.ready` tells scripts when, and that it works.
"use strict";

async function start() {
  const text = id => document.getElementById(id).textContent;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  document.documentElement.dataset.theme = dark.matches ? "dark" : "light";
  dark.addEventListener("change", () => { document.documentElement.dataset.theme = dark.matches ? "dark" : "light"; });
  const scene = JSON.parse(text("scene"));
  showFacts(scene);
  if (innerWidth < NARROW) document.body.classList.add("closed");
  if (!document.createElement("canvas").getContext("webgl2")) throw new Error(NO_WEBGL);
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await inflated(text("library")));
  document.head.append(script);
  const bytes = await inflated(text("arrays"));
  const viewer = new Viewer(scene, bytes, document.getElementById("canvas"));
  const panel = new Panel(viewer);
  dark.addEventListener("change", () => panel.setTheme(dark.matches ? "dark" : "light"));
  viewer.drawNow();
  document.body.dataset.state = "ready";
  return {viewer, panel};
}

const NO_WEBGL = "this browser shows no WebGL";

window.medialisViewer = {ready: start()};
window.medialisViewer.ready.catch(error => {
  let scene = null;
  try { scene = JSON.parse(document.getElementById("scene").textContent); } catch { /* said below */ }
  const old = typeof DecompressionStream === "undefined";
  showWithoutCanvas(scene, old ? "this browser is too old" : error.message ?? String(error));
  document.body.dataset.state = "failed";
  if (error.message !== NO_WEBGL) console.error(error);
});

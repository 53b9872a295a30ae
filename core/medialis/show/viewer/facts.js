// What the page says in words: it needs no WebGL, and is there before anything is drawn.
"use strict";

function placeName(place) { return `${place.noun} ${place.number}: ${place.text}`; }

function showFacts(data) {
  const byId = name => document.getElementById(name);
  byId("title").textContent = document.title = data.title;
  byId("still").alt = `A picture of ${data.title}`;
  const tables = [...new Set(data.places.map(place => place.table))];
  byId("places").replaceChildren(...tables.map(table => placeSection(
    data.places.filter(place => place.table === table))));
  byId("numbersection").hidden = data.numbers.length === 0;
  byId("numberlist").replaceChildren(...data.numbers.flatMap(([name, text]) =>
    [element("dt", {textContent: name}), element("dd", {textContent: text})]));
  byId("notes").hidden = data.notes.length === 0;
  byId("notelist").replaceChildren(...data.notes.map(note => element("li", {textContent: note})));
}

// A list of places; where they are numbered on the shape, with a box that hides the numbers there.
function placeSection(places) {
  const heading = element("h2", {textContent: places[0].heading});
  const rows = places.map(place => element("li", {}, element("button", {},
    element("b", {textContent: place.number}), ` ${place.text}`)));
  if (!places[0].onShape) return element("section", {}, heading, element("ol", {className: "places"}, ...rows));
  const box = element("label", {className: "numbers"},
    element("input", {id: "numbers", type: "checkbox", checked: true}), " numbers on the shape");
  return element("section", {}, heading, box, element("ol", {className: "places"}, ...rows));
}

// Instead of the canvas: the picture and why; places say where they are, since nothing can fly there.
function showWithoutCanvas(data, why) {
  const byId = name => document.getElementById(name);
  document.body.classList.add("flat");
  document.body.classList.remove("closed");
  for (const name of ["layersection", "hint", "canvas", "section", "legend", "labels"]) byId(name).hidden = true;
  for (const one of document.querySelectorAll("nav, .numbers")) one.hidden = true;
  byId("why").textContent = `The shape cannot be turned here: ${why}.`;
  byId("failed").hidden = false;
  byId("still").hidden = !byId("still").getAttribute("src");
  for (const one of document.querySelectorAll("details")) one.open = true;
  if (!data) return;
  const decimals = Math.min(12, Math.max(0, 3 - Math.floor(Math.log10(data.diagonal))));
  const at = place => place.position.map((x, axis) => (x + data.origin[axis]).toFixed(decimals)).join(", ");
  document.querySelectorAll("#places li").forEach((row, i) => {
    const place = data.places[i];
    row.replaceChildren(element("b", {textContent: place.number}), ` ${place.text}, at (${at(place)})`);
  });
}

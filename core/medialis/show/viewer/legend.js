// Colours, numbers and elements that the panel is made of.
"use strict";

const SWATCHES = 14, BARS = 96;

function element(tag, properties = {}, ...inside) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties))
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made) made[name] = value;
    else made.setAttribute(name, value);
  made.append(...inside);
  return made;
}

function said(number) {
  if (number === null || Number.isNaN(number)) return "–";
  if (!Number.isFinite(number)) return number > 0 ? "infinite" : "minus infinite";
  if (Number.isInteger(number)) return String(number);
  const size = Math.abs(number);
  return size >= 1e-4 && size < 1e6 ? String(Number(number.toPrecision(4))) : number.toExponential(3);
}

// The next share of a range at which the value is round, so many steps on: about 50 cover the range.
function stepped(share, low, high, steps) {
  const span = high - low;
  if (!(span > 0)) return share;
  const power = 10 ** Math.floor(Math.log10(span / 50));
  const step = [1, 2, 5, 10].map(x => x * power).find(x => x >= (1 - 1e-9) * span / 50);
  const at = (low + share * span) / step, whole = Math.round(at);
  const from = Math.abs(at - whole) < 1e-6 ? whole : steps > 0 ? Math.floor(at) : Math.ceil(at);
  return Math.min(1, Math.max(0, ((from + steps) * step - low) / span));
}

// Arrow keys are one step, Page Up and Page Down ten, Home and End the ends.
function byArrow(event, call) {
  const steps = {ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10,
    Home: -1e9, End: 1e9}[event.key];
  if (steps === undefined) return;
  event.preventDefault();
  call(steps);
}

// The colours of a field from its smallest to its largest value.
function colorsOf(data, field, count) {
  const bytes = base64Bytes(data.maps[field.map]), last = bytes.length / 3 - 1;
  const [first, end] = field.limits, span = end - first || 1;
  return Array.from({length: count}, (_, i) => {
    const value = field.low + (field.high - field.low) * i / (count - 1);
    const at = 3 * Math.round(last * Math.min(1, Math.max(0, (value - first) / span)));
    return `rgb(${bytes[at]}, ${bytes[at + 1]}, ${bytes[at + 2]})`;
  });
}

// The colours as bars whose heights say how many values there are.
function drawBar(canvas, field, colors) {
  const bins = colors.length, counts = new Uint32Array(bins);
  for (const code of field.values)
    if (code >= 0 && code <= 1) counts[Math.min(bins - 1, Math.floor(bins * code))]++;
  const most = Math.max(...counts), pen = canvas.getContext("2d"), {width, height} = canvas;
  pen.clearRect(0, 0, width, height);
  colors.forEach((color, i) => {
    const tall = counts[i] ? 10 + (height - 34) * Math.sqrt(counts[i] / most) : 0;
    pen.fillStyle = color;
    pen.fillRect(i * width / bins, height - 22, width / bins + 1, 22);
    pen.fillRect(i * width / bins, height - 24 - tall, width / bins - 1, tall);
  });
}

// The numbers of segments with their colours.
function swatchesOf(data, field) {
  const labels = [...new Set(field.values)].filter(label => label >= 0).sort((a, b) => a - b);
  const bytes = base64Bytes(field.colors ?? data.palette), count = bytes.length / 3;
  const shown = labels.slice(0, SWATCHES).map(label => {
    const at = 3 * (label % count), swatch = element("i");
    swatch.style.background = `rgb(${bytes[at]}, ${bytes[at + 1]}, ${bytes[at + 2]})`;
    return element("span", {}, swatch, field.classes[label] ?? String(label));
  });
  return labels.length > SWATCHES ? [...shown, `… ${labels.length} in all`] : shown;
}

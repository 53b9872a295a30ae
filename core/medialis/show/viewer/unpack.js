// Arrays back from the text of the page; see packing.py.
"use strict";

const MISSING_CODE = -1, INFINITE_CODE = 2, LEVELS = 65533;

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Whole numbers of one block, row by row.
function wholeNumbers(bytes, where) {
  const {at, rows, columns, differences} = where, count = rows * columns;
  const found = new Int32Array(count);
  for (let column = 0; column < columns; column++) {
    let before = 0;
    for (let row = 0; row < rows; row++) {
      let folded = 0;
      for (let byte = where.bytes - 1; byte >= 0; byte--)
        folded = folded * 256 + bytes[at + byte * count + column * rows + row];
      const step = folded % 2 ? -(folded + 1) / 2 : folded / 2;
      before = differences ? before + step : step;
      found[row * columns + column] = before;
    }
  }
  return found;
}

function unpackedPoints(bytes, points) {
  const codes = wholeNumbers(bytes, points.codes), found = new Float32Array(codes.length);
  for (let i = 0; i < codes.length; i++) found[i] = points.low[i % 3] + points.step * codes[i];
  return found;
}

function unpackedFaces(bytes, [first, above]) {
  const corner = wholeNumbers(bytes, first), others = wholeNumbers(bytes, above);
  const found = new Uint32Array(3 * corner.length);
  for (let i = 0; i < corner.length; i++) {
    found[3 * i] = corner[i];
    found[3 * i + 1] = corner[i] + others[2 * i];
    found[3 * i + 2] = corner[i] + others[2 * i + 1];
  }
  return found;
}

// Shares 0..1 of the range of a field, MISSING_CODE or INFINITE_CODE; for labels their numbers.
function unpackedCodes(bytes, field) {
  const codes = wholeNumbers(bytes, field.codes), found = new Float32Array(codes.length);
  for (let i = 0; i < codes.length; i++)
    found[i] = field.label ? codes[i] - 1
      : codes[i] <= LEVELS ? codes[i] / LEVELS
      : codes[i] === LEVELS + 1 ? INFINITE_CODE : MISSING_CODE;
  return found;
}

// Mean normals of the faces at each vertex, by area; of clouds none.
function vertexNormals(points, faces) {
  const found = new Float32Array(points.length);
  for (let i = 0; i < faces.length; i += 3) {
    const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    for (const at of [a, b, c]) {
      found[at] += nx;
      found[at + 1] += ny;
      found[at + 2] += nz;
    }
  }
  for (let i = 0; i < found.length; i += 3) {
    const length = Math.hypot(found[i], found[i + 1], found[i + 2]) || 1;
    found[i] /= length;
    found[i + 1] /= length;
    found[i + 2] /= length;
  }
  return found;
}

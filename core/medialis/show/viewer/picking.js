// What lies under the pointer: found among the points and triangles of all parts that are seen.
"use strict";

const TOUCH = 9;  // pixels

// The first triangle that a ray meets, and the nearest corner: {distance, row}, or null.
function metTriangle(part, eye, ray) {
  const {points: p, faces} = part;
  let best = null;
  for (let i = 0; i < faces.length; i += 3) {
    const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const hx = ray.y * vz - ray.z * vy, hy = ray.z * vx - ray.x * vz, hz = ray.x * vy - ray.y * vx;
    const volume = ux * hx + uy * hy + uz * hz;
    if (volume === 0) continue;
    const sx = eye.x - p[a], sy = eye.y - p[a + 1], sz = eye.z - p[a + 2];
    const s = (sx * hx + sy * hy + sz * hz) / volume;
    if (s < 0 || s > 1) continue;
    const qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux;
    const t = (ray.x * qx + ray.y * qy + ray.z * qz) / volume;
    if (t < 0 || s + t > 1) continue;
    const distance = (vx * qx + vy * qy + vz * qz) / volume;
    if (distance <= 0 || (best && distance >= best.distance)) continue;
    const corner = s + t < 0.5 && 1 - s - t >= Math.max(s, t) ? i : s > t ? i + 1 : i + 2;
    if (part.isSeen(faces[i])) best = {distance, row: faces[corner]};
  }
  return best;
}

// The foremost of the dots under the pointer, else the nearest within some pixels, or null.
function metPoint(part, eye, ray, pixels) {
  const p = part.points, same = part.uniforms.radius.value;
  let best = null;
  for (let i = 0; i < part.count; i++) {
    const x = p[3 * i] - eye.x, y = p[3 * i + 1] - eye.y, z = p[3 * i + 2] - eye.z;
    const along = x * ray.x + y * ray.y + z * ray.z;
    if (along <= 0) continue;
    const off = Math.sqrt(Math.max(0, x * x + y * y + z * z - along * along));
    const radius = part.balls ? part.size * part.balls[i] : same, allowed = Math.max(radius, TOUCH * along / pixels);
    if (off > allowed || !part.isSeen(i)) continue;
    const score = off <= radius ? along - (part.balls ? Math.sqrt(radius * radius - off * off) : 0) : 1e9 * (1 + off / along);
    if (!best || score < best.score) best = {distance: along, row: i, score};
  }
  return best;
}

// What lies inside a see-through surface is meant before the surface.
function pickedAt(viewer, x, y) {
  const {origin: eye, direction: ray} = viewer.rayThrough(x, y);
  const pixels = viewer.pixelsAtOne() / viewer.ratio();
  let best = null;
  for (const part of viewer.parts) {
    if (!part.visible) continue;
    const isSurface = part.kind === "surface";
    const met = isSurface ? metTriangle(part, eye, ray) : metPoint(part, eye, ray, pixels);
    if (!met) continue;
    const rank = isSurface && part.opacity < 0.5 ? 1 : 0;
    if (!best || rank < best.rank || (rank === best.rank && met.distance < best.distance))
      best = {...met, part, rank};
  }
  return best;
}

// The ball that touches a place: the one whose sphere passes nearest to it.
function touchingBall(viewer, place) {
  let best = null;
  for (const part of viewer.parts) {
    const field = part.fields.find(one => one.name === "radius");
    if (part.kind !== "points" || !field) continue;
    for (let i = 0; i < part.count; i++) {
      const p = part.points, radius = part.value(field, i);
      const away = Math.hypot(p[3 * i] - place[0], p[3 * i + 1] - place[1], p[3 * i + 2] - place[2]);
      const gap = Math.abs(away - radius);
      if (radius !== null && (!best || gap < best.gap)) best = {part, row: i, radius, gap};
    }
    break;
  }
  return best && best.gap < 0.01 * viewer.diagonal ? best : null;
}

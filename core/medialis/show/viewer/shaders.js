// What the graphics card does: colours, threshold and section of every part, without new buffers.
"use strict";

const COMMON = `
precision highp float;
uniform sampler2D colors;   // the colour map, or the colours of labels
uniform vec2 scale;         // colour coordinate = scale.x * code + scale.y
uniform vec2 keep;          // codes outside are hidden or grey
uniform vec3 plain;         // without values, and where they are missing
uniform vec4 cut;           // points with dot(cut.xyz, p) > cut.w are cut away
uniform int mode;           // 0 plain, 1 values, 2 labels
bool kept(float code) {
  if (mode != 1) return true;
  if (code < -0.5) return keep.x <= 0.0 && keep.y >= 1.0;
  return code >= keep.x - 1e-6 && (code <= keep.y + 1e-6 || (code > 1.5 && keep.y >= 1.0));
}
vec3 colored(float code) {
  if (mode == 0 || code < -0.5) return plain;
  if (mode == 2) return texelFetch(colors, ivec2(int(code + 0.5) % textureSize(colors, 0).x, 0), 0).rgb;
  return texture(colors, vec2(clamp(scale.x * min(code, 1.0) + scale.y, 0.002, 0.998), 0.5)).rgb;
}
vec3 lit(vec3 color, vec3 n) {
  vec3 linear = pow(color, vec3(2.2));
  float key = max(dot(n, normalize(vec3(-0.35, 0.55, 0.75))), 0.0);
  float fill = max(dot(n, normalize(vec3(0.7, -0.1, 0.5))), 0.0);
  float shine = pow(max(dot(n, normalize(vec3(-0.2, 0.35, 1.0))), 0.0), 40.0);
  vec3 light = linear * (0.30 + 0.62 * key + 0.22 * fill) + 0.05 * shine;
  return pow(light, vec3(1.0 / 2.2));
}`;

const SURFACE_VERTEX = `
in float code;
out vec3 place;
out vec3 away;
out vec3 toEye;
out float value;
flat out float label;
void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  place = position;
  away = normalMatrix * normal;
  toEye = -seen.xyz;
  value = code;
  label = code;
  gl_Position = projectionMatrix * seen;
}`;

const SURFACE_FRAGMENT = `${COMMON}
uniform float opacity;
uniform vec3 inner;         // the inside of a surface that is cut open
uniform bool isCut;
uniform bool facets;
in vec3 place;
in vec3 away;
in vec3 toEye;
in float value;
flat in float label;
out vec4 fragment;
void main() {
  if (dot(cut.xyz, place) > cut.w) discard;
  vec3 n = facets ? cross(dFdx(toEye), dFdy(toEye)) : away;
  n = normalize(n);
  if (facets ? n.z < 0.0 : !gl_FrontFacing) n = -n;
  float code = mode == 2 ? label : value;
  vec3 color = kept(code) ? colored(code) : plain;
  if (opacity > 0.99) {
    bool inside = isCut && !gl_FrontFacing;
    fragment = vec4(inside ? inner : lit(color, n), 1.0);
    return;
  }
  // Denser where the surface is seen from the side, as glass is.
  float side = 1.0 - abs(dot(n, normalize(toEye)));
  float dense = opacity * (0.35 + 2.2 * side * side * side);
  fragment = vec4(lit(color, n), clamp(dense, 0.0, 1.0));
}`;

const POINT_VERTEX = `${COMMON}
in float code;
in float ball;              // the radius of the ball here
uniform float radius;
uniform float ballSize;     // 0: all dots are alike; else balls are so many times as large
uniform float pixels;       // of one unit of length at distance 1
out float value;
flat out vec4 middle;       // z to the eye, radius, and what makes a depth of z
void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  float size = ballSize > 0.0 ? ballSize * ball : radius;
  value = code;
  middle = vec4(seen.z, size, projectionMatrix[2][2], projectionMatrix[3][2]);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = clamp(2.0 * size * pixels / -seen.z, 1.5, ballSize > 0.0 ? 2048.0 : 96.0);
  if (!kept(code) || dot(cut.xyz, position) > cut.w) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = 0.0;
  }
}`;

const POINT_FRAGMENT = `${COMMON}
in float value;
flat in vec4 middle;
out vec4 fragment;
void main() {
  vec2 q = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
  float square = dot(q, q);
  if (square > 1.0) discard;
  float z = min(middle.x + middle.y * sqrt(1.0 - square), -1e-6);
  gl_FragDepth = 0.5 - 0.5 * (middle.z * z + middle.w) / z;
  fragment = vec4(lit(colored(value), vec3(q, sqrt(1.0 - square))), 1.0);
}`;

// One strip of two triangles an edge, turned to the eye and shaded as a tube.
const TUBE_VERTEX = `
in vec3 start;
in vec3 end;
in vec2 codes;
uniform float radius;
out float across;
out float value;
out vec3 place;
out vec3 sideways;
out vec3 toEye;
void main() {
  place = mix(start, end, position.x);
  vec3 a = (modelViewMatrix * vec4(start, 1.0)).xyz, b = (modelViewMatrix * vec4(end, 1.0)).xyz;
  vec3 here = mix(a, b, position.x);
  sideways = normalize(cross(b - a, here));
  across = position.y;
  value = mix(codes.x, codes.y, position.x);
  toEye = normalize(-here);
  here += 0.5 * radius * toEye;  // the dots at the nodes only fill what is open between tubes
  gl_Position = projectionMatrix * vec4(here + radius * across * sideways, 1.0);
}`;

const TUBE_FRAGMENT = `${COMMON}
in float across;
in float value;
in vec3 place;
in vec3 sideways;
in vec3 toEye;
out vec4 fragment;
void main() {
  if (!kept(value) || dot(cut.xyz, place) > cut.w) discard;
  vec3 n = normalize(across * sideways + sqrt(max(0.0, 1.0 - across * across)) * toEye);
  fragment = vec4(lit(colored(value), n), 1.0);
}`;

precision highp float;

in vec3 seen, place, tint;
uniform vec3 clipLow, clipHigh;
uniform float light;
out vec4 result;

void main() {
  if (any(lessThan(place, clipLow)) || any(greaterThan(place, clipHigh))) discard;
  vec3 normal = normalize(cross(dFdx(seen), dFdy(seen))); // of the triangle, to the viewer
  float lit = 0.5 + 0.62 * max(dot(normal, normalize(vec3(-0.35, 0.45, 0.82))), 0.0);
  result = vec4(tint * mix(1.0, lit, light), 1.0);
}

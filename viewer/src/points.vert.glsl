// Points as discs that lie in the surface.
in vec3 position;   // 0 to 1 in 16 bits, or in steps
in vec2 octahedral; // the normal, folded out to a square
in float rank;      // row in the file
in float spread;    // distance to the next points, relative to the usual one: 128 + 40 log2
in float joined;    // 1 for a vertex of the surface

uniform mat4 modelViewMatrix, projectionMatrix;
uniform mat3 normalMatrix;
uniform vec3 low, extent, clipLow, clipHigh;
uniform float radius, pixels, limit, light;
uniform bool solid;      // whether the surface is drawn, too
uniform vec3 middle;     // of the node of an octree
uniform float radii[8];  // factors of the radius in its eight parts

out vec3 tint;
flat out vec3 facing;
flat out vec2 disc; // where its centre lies along the line of sight, and its radius

void main() {
  vec3 place = low + position * extent;
  vec4 seen = modelViewMatrix * vec4(place, 1.0);
  gl_Position = projectionMatrix * seen;
  vec2 folded = octahedral * 2.0 - 1.0;
  vec3 normal = vec3(folded, 1.0 - abs(folded.x) - abs(folded.y));
  if (normal.z < 0.0) normal.xy = (1.0 - abs(normal.yx)) * vec2(normal.x < 0.0 ? -1.0 : 1.0, normal.y < 0.0 ? -1.0 : 1.0);
  normal = normalize(normalMatrix * normal);
  facing = dot(normal, seen.xyz) > 0.0 ? -normal : normal; // to the viewer: signs are arbitrary
  float lit = 0.5 + 0.62 * max(dot(facing, normalize(vec3(-0.35, 0.45, 0.82))), 0.0);
  tint = plainTint() * mix(1.0, lit, light);
  bvec3 beyond = greaterThanEqual(position, middle);
  float factor = radii[int(beyond.x) + 2 * int(beyond.y) + 4 * int(beyond.z)];
  float wide = solid ? min(spread, 128.0) : spread; // beside a surface, isolated points stay small
  gl_PointSize = clamp(2.0 * radius * factor * exp2((wide - 128.0) / 40.0) * pixels / -seen.z, 1.5, 64.0);
  disc = vec2(seen.z, gl_PointSize * -seen.z / (2.0 * pixels));
  bool clipped = any(lessThan(place, clipLow)) || any(greaterThan(place, clipHigh));
  if (rank >= limit || clipped || (solid && joined > 0.5)) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
}

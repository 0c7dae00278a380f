precision highp float;

in vec3 tint;
flat in vec3 facing;
flat in vec2 disc;
uniform mat4 projectionMatrix;
out vec4 result;

const float BULGE = 0.3; // makes the disc with the nearest centre the one that is seen

void main() {
  vec2 at = (gl_PointCoord * 2.0 - 1.0) * vec2(1.0, -1.0);
  float deeper = dot(at, facing.xy) / max(facing.z, 0.3);
  if (dot(at, at) + deeper * deeper > 1.0) discard;
  float z = disc.x - disc.y * (deeper + BULGE * dot(at, at));
  gl_FragDepth = 0.5 - 0.5 * (projectionMatrix[2][2] + projectionMatrix[3][2] / z);
  result = vec4(tint, 1.0);
}

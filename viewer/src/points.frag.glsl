precision mediump float;

in vec3 tint;
flat in vec3 facing;
out vec4 result;

void main() {
  vec2 at = (gl_PointCoord * 2.0 - 1.0) * vec2(1.0, -1.0);
  float deeper = dot(at, facing.xy) / max(facing.z, 0.3);
  if (dot(at, at) + deeper * deeper > 1.0) discard;
  result = vec4(tint, 1.0);
}

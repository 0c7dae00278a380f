precision highp float;

// A surface rebuilt from points.
in vec3 position; // 0 to 1, in 16 bits

uniform mat4 modelViewMatrix, projectionMatrix;
uniform vec3 low, extent;

out vec3 seen;

void main() {
  vec4 place = modelViewMatrix * vec4(low + position * extent, 1.0);
  seen = place.xyz;
  gl_Position = projectionMatrix * place;
}

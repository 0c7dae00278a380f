// A surface.
in vec3 position; // 0 to 1, in 16 bits

uniform mat4 modelViewMatrix, projectionMatrix;
uniform vec3 low, extent;

out vec3 seen, place, tint;

void main() {
  tint = plainTint();
  place = low + position * extent;
  seen = (modelViewMatrix * vec4(place, 1.0)).xyz;
  gl_Position = projectionMatrix * vec4(seen, 1.0);
}

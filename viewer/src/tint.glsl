precision highp float;
precision highp int;

// The colour of a point, or of a vertex.
in float amount; // the value to colour by, 0 to 65535
in vec3 colour;  // RGB of the scan

uniform vec3 scale; // value at the low end, 1 / range, exponent; in the numbers of `amount`
uniform int mode;   // 0: the value, 1: RGB, 2: kinds
uniform sampler2D table;

vec3 plainTint() {
  if (mode == 1) return colour;
  if (amount > 65534.5) return vec3(0.6);
  float step = mode == 2 ? (mod(amount, 256.0) + 0.5) / 256.0
                         : pow(clamp((amount - scale.x) * scale.y, 0.0, 1.0), scale.z) * (255.0 / 256.0) + 0.5 / 256.0;
  return texture(table, vec2(step, 0.5)).rgb;
}


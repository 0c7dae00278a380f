precision highp float;

// Eye-dome lighting (Boucheny 2009): a pixel is darker the deeper it lies behind its neighbours.
uniform sampler2D picture, depths;
uniform vec2 texel;
uniform vec3 background;
uniform float near, far, strength;
out vec4 result;

float logarithmic(vec2 at) {
  float depth = texture(depths, at).r;
  return depth >= 1.0 ? 1e3 : log2(near * far / (far - depth * (far - near)));
}

void main() {
  vec2 at = gl_FragCoord.xy * texel;
  vec4 seen = texture(picture, at);
  if (seen.a == 0.0) { result = vec4(background, 1.0); return; }
  float shade = 1.0;
  if (strength > 0.0) {
    float own = logarithmic(at), sum = 0.0;
    for (int i = 0; i < 8; i++) {
      float angle = float(i) * 0.78539816;
      float other = logarithmic(at + vec2(cos(angle), sin(angle)) * texel * 1.6);
      sum += other > 999.0 ? 0.0 : max(0.0, own - other);
    }
    shade = max(0.3, exp(-strength * sum / 8.0));
  }
  result = vec4(seen.rgb * shade, 1.0);
}

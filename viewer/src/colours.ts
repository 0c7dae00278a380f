// Colours: viridis for amounts, the palette of Okabe and Ito for kinds; both can be told apart by colour-blind people.

// viridis of matplotlib from 0.16 to 1 of its length: darker colours would hide the shading.
const VIRIDIS = [
  "#46317e", "#433d84", "#3d4c8a", "#38588c", "#32648e", "#2d708e", "#297b8e", "#25858e", "#21908d", "#1e9c89",
  "#22a785", "#2eb37c", "#42be71", "#5ec962", "#7fd34e", "#a2da37", "#c5e021", "#e7e419", "#fde725",
];
export const KINDS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#8a7f00", "#7a5195"];
export const UNKNOWN_COLOUR = "#9a9a9a";

function parts(colour: string): number[] {
  return [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
}

/** Return RGBA for `count` steps of the colour map. */
export function amounts(count = 256): Uint8Array<ArrayBuffer> {
  const table = new Uint8Array(count * 4);
  for (let i = 0; i < count; i++) {
    const place = (i / (count - 1)) * (VIRIDIS.length - 1);
    const low = Math.min(Math.floor(place), VIRIDIS.length - 2);
    const [a, b] = [parts(VIRIDIS[low]!), parts(VIRIDIS[low + 1]!)];
    for (let c = 0; c < 3; c++) table[i * 4 + c] = Math.round(a[c]! + (b[c]! - a[c]!) * (place - low));
    table[i * 4 + 3] = 255;
  }
  return table;
}

/** Return RGBA for `count` kinds. */
export function kinds(count = 256): Uint8Array<ArrayBuffer> {
  const table = new Uint8Array(count * 4);
  for (let i = 0; i < count; i++) table.set([...kindColour(i), 255], i * 4);
  return table;
}

/** Return the RGB of a kind: the palette, then the palette lightened, and so on in turn. */
export function kindColour(i: number): number[] {
  const colour = parts(KINDS[i % KINDS.length]!);
  return Math.floor(i / KINDS.length) % 2 ? colour.map((part) => Math.round(part + 0.55 * (255 - part))) : colour;
}

/** Return the colour map as a fill of a drawing, from a place to the right. */
export function ramp(context: CanvasRenderingContext2D, left: number, width: number): CanvasGradient {
  const fill = context.createLinearGradient(left, 0, left + width, 0);
  VIRIDIS.forEach((colour, i) => fill.addColorStop(i / (VIRIDIS.length - 1), colour));
  return fill;
}

export function gradient(): string {
  return `linear-gradient(to right, ${VIRIDIS.join(", ")})`;
}

// What Python wrote into the page: a description in JSON, and packed arrays.

/** One quantity of the points of a cloud, in 16 bits: low + step * number; the largest number means "unknown". */
export interface Values {
  key: string;
  title: string;
  unit: string;
  low: number;
  step: number;
  /** The ends of the colour scale. */
  from: number;
  to: number;
  /** Whether colours follow the square root of the value. */
  root: boolean;
  categories: number[] | null;
  block: string;
}

/** The surface of a cloud: of its file, through its points, or rebuilt from them. */
export interface Surface {
  vertices: number;
  triangles: number;
  low: [number, number, number];
  step: [number, number, number];
  /** The number of points that are no vertices, and are shown with the surface. */
  missed: number;
  blocks: { positions: string; faces: string; points: string; missed?: string };
}

export interface Prefix {
  points: number;
  figures: Record<string, number | null>;
  relative: Record<string, number | null>;
}

export interface Cloud {
  name: string;
  role: "original" | "result" | "cloud";
  /** What its points are: those of a mesh are its vertices. */
  counted: "points" | "vertices";
  points: number;
  shown: number;
  low: [number, number, number];
  step: [number, number, number];
  spacing: number;
  blocks: { positions: string; normals: string; spreads: string; rows?: string; colours?: string; originals?: string };
  values: Values[];
  prefixes: Prefix[];
  mesh: Surface | null;
  /** In a few words, why the points of a result were chosen, if it is known. */
  reason: string | null;
  octree?: Levels;
}

/** What a file says of its octree. */
export interface Levels {
  low: [number, number, number];
  side: number;
  /** Of the points of the first level. */
  spacing: number;
  scales: [number, number, number];
  offsets: [number, number, number];
  /** How many of the nodes the page holds. */
  inside: number;
  /** Level, place, number of points and row of the first one, from coarse to fine. */
  nodes: [level: number, x: number, y: number, z: number, count: number, row: number][];
}

export interface Figure {
  name: string;
  title: string;
  unit: string;
  definition: string;
  better: "less" | "more" | null;
  /** Whether it is shown before somebody asks for all. */
  first: boolean;
}

export interface Description {
  title: string;
  lead: string;
  notes: string[];
  up: string;
  azimuth: number;
  elevation: number;
  together: boolean;
  /** Whether surfaces are shown at first, where there are some. */
  solid: boolean;
  /** What classes of LAS files are called, by number. */
  classes: string[];
  diagonal: number;
  /** Of lengths; empty if the file does not tell it. */
  unit: string;
  clouds: Cloud[];
  figures: Figure[];
  made: [string, string][];
}

export const UNKNOWN = 65535;

export function description(): Description {
  return JSON.parse(document.getElementById("description")!.textContent!);
}

/** Return the bytes of a text in base64. */
function bytesOf(text: string): Uint8Array<ArrayBuffer> {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

type Numbers = Uint8Array<ArrayBuffer> | Uint16Array<ArrayBuffer> | Uint32Array<ArrayBuffer>;

/** Unpack an array of n rows: columns of differences, each as planes of bytes from the lowest, deflated. */
async function unpacked<A extends Numbers>(id: string, n: number, columns: number, kind: new (n: number) => A) {
  const packed = bytesOf(document.getElementById(id)!.textContent!.trim());
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const array = new kind(n * columns);
  const width = array.BYTES_PER_ELEMENT;
  if (planes.length !== array.byteLength) throw new Error(`block ${id} has ${planes.length} bytes`);
  for (let column = 0; column < columns; column++) {
    const first = column * width * n;
    for (let row = 0, sum = 0; row < n; row++) {
      for (let byte = 0; byte < width; byte++) sum += planes[first + byte * n + row]! << (8 * byte);
      array[row * columns + column] = sum; // the array keeps the lowest bits, as Python did
      sum = array[row * columns + column]!;
    }
  }
  return array;
}

/** The arrays of a cloud, in the order of its rows. */
export interface Arrays {
  /** In 16 bits, or in a node of an octree in whole numbers. */
  positions: Uint16Array<ArrayBuffer> | Float32Array<ArrayBuffer>;
  normals: Uint8Array<ArrayBuffer>;
  spreads: Uint8Array<ArrayBuffer>;
  rows: Uint32Array<ArrayBuffer>;
  colours: Uint8Array<ArrayBuffer> | null;
  originals: Uint32Array<ArrayBuffer> | null;
}

export async function arraysOf(cloud: Cloud): Promise<Arrays> {
  const { blocks, shown: n } = cloud;
  const rows = blocks.rows ? unpacked(blocks.rows, n, 1, Uint32Array) : Uint32Array.from({ length: n }, (_, i) => i);
  return {
    positions: await unpacked(blocks.positions, n, 3, Uint16Array),
    normals: await unpacked(blocks.normals, n, 2, Uint8Array),
    spreads: await unpacked(blocks.spreads, n, 1, Uint8Array),
    rows: await rows,
    colours: blocks.colours ? await unpacked(blocks.colours, n, 3, Uint8Array) : null,
    originals: blocks.originals ? await unpacked(blocks.originals, n, 1, Uint32Array) : null,
  };
}

/** Return x, y and z of a point as in the file, given its place in the arrays. */
export function coordinates({ low, step }: Cloud, { positions }: Arrays, index: number): [number, number, number] {
  const at = (axis: 0 | 1 | 2) => low[axis] + step[axis] * positions[3 * index + axis]!;
  return [at(0), at(1), at(2)];
}

/** The vertices of a surface, and for each triangle three of their numbers. */
export interface Triangles {
  positions: Uint16Array<ArrayBuffer>;
  faces: Uint32Array<ArrayBuffer>;
  /** For each vertex the place of the point whose colour it has. */
  points: Uint32Array<ArrayBuffer>;
  /** The places of the points that are no vertices, if they are shown. */
  missed: Uint32Array<ArrayBuffer> | null;
}

export async function trianglesOf({ blocks, vertices, triangles, missed: n }: Surface): Promise<Triangles> {
  const faces = await unpacked(blocks.faces, triangles, 3, Uint32Array);
  // The second and third column are running sums of the steps from the first vertex.
  for (let i = faces.length - 3; i >= 0; i -= 3)
    for (const j of [i + 1, i + 2]) faces[j] = faces[i]! + faces[j]! - (i > 0 ? faces[j - 3]! : 0);
  const points = await unpacked(blocks.points, vertices, 1, Uint32Array);
  const missed = blocks.missed ? await unpacked(blocks.missed, n, 1, Uint32Array) : null;
  return { positions: await unpacked(blocks.positions, vertices, 3, Uint16Array), faces, points, missed };
}

export function valuesOf(cloud: Cloud, values: Values): Promise<Uint16Array<ArrayBuffer>> {
  return unpacked(values.block, cloud.shown, 1, Uint16Array);
}

/** Return a number with about four digits, or with all of a whole number. */
export function shown(value: number, digits = 4): string {
  if (Number.isInteger(value) && Math.abs(value) < 1e15) return value.toLocaleString("en");
  const size = Math.abs(value);
  if (size >= 1e6 || (size > 0 && size < 1e-4)) return value.toExponential(digits - 1).replace("e+", "e");
  return String(Number(value.toPrecision(size >= 1000 ? digits + 2 : digits)));
}

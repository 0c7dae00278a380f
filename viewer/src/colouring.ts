// What colours can show, and the colours of the layers.
import { kindsOf } from "./classes";
import { UNKNOWN, type Cloud, type Values } from "./data";
import { Layer } from "./scene";
import type { State } from "./state";

// The colourings that no single list of values holds.
export const ORDER = "order";
export const RGB = "rgb";
export const DISTANCE = "distance";

const PLAIN: [number, number, number] = [0, 1, 1]; // the scale of a layer without values

/** The ends of a colour scale, and one of the lists of values that it shows. */
export interface Ends {
  from: number;
  to: number;
  values: Values;
}

/** Return the keys and titles of all colourings. */
export function colourings({ clouds, original, longest }: State): [string, string][] {
  const all = clouds.flatMap(({ values }) => values);
  const titles = new Map<string, string>();
  if (clouds.some(({ blocks }) => blocks.colours)) titles.set(RGB, "RGB");
  for (const { key, title } of all) if (!key.startsWith(`${DISTANCE}:`)) titles.set(key, title);
  if (all.some((values) => isOf(values, DISTANCE))) titles.set(DISTANCE, "distance of the original to the result");
  if (longest > 0) titles.set(ORDER, original < 0 ? "order in the file" : "order of choice");
  return [...titles];
}

/** Return the values of a cloud by their key. */
export function valuesFor(cloud: Cloud, key: string): Values | undefined {
  return cloud.values.find((values) => values.key === key);
}

/** Return whether a colouring shows some values; that by distance shows the distances to all results. */
export function isOf(values: Values, key: string): boolean {
  return key === DISTANCE ? values.key.startsWith(`${DISTANCE}:`) : values.key === key;
}

/** Return the ends of a colour scale: as set, or those of the original, or of all clouds if it has no such values. */
export function endsOf({ clouds, original, ranges }: State, key: string): Ends | null {
  const of = (some: Cloud[]) => some.flatMap((cloud) => cloud.values.filter((values) => isOf(values, key)));
  const first = original < 0 ? [] : of([clouds[original]!]);
  const found = first.length > 0 ? first : of(clouds); // the original decides: results differ only by its sampling
  if (found.length === 0) return null;
  const [from, to] = ranges.get(key) ?? [Math.min(...found.map((v) => v.from)), Math.max(...found.map((v) => v.to))];
  return { from, to, values: found[0]! };
}

/** Give the layers the colours that are set, unless they have them. */
export function recolour(state: State): void {
  const { clouds, layers, colouring, numbers, ranges } = state;
  const known = clouds.flatMap(({ values }) => values).filter((values) => isOf(values, colouring) && numbers.has(values));
  const coloured = `${colouring} ${known.length} ${ranges.get(colouring)}`;
  if (coloured === state.coloured) return;
  state.coloured = coloured;
  const ends = endsOf(state, colouring);
  if (colouring === DISTANCE) colourDistances(state, ends!);
  else for (const layer of layers) colourLayer(state, layer, ends);
  for (const { octree } of layers) for (const node of octree?.loaded ?? []) colourNode(state, node);
}

/** Give the points of a node the colours that are set. */
export function colourNode(state: State, node: Layer): void {
  colourLayer(state, node, endsOf(state, state.colouring));
}

function colourLayer(state: State, layer: Layer, ends: Ends | null): void {
  const { colouring } = state;
  const { cloud, arrays } = layer;
  const values = valuesFor(cloud, colouring);
  if (colouring === RGB) layer.colour(arrays.colours ? 1 : 0, null, PLAIN);
  else if (colouring === ORDER && cloud.role !== "original") {
    const last = Math.max(1, cloud.points - 1);
    layer.colour(0, Uint16Array.from(arrays.rows, (row) => row / last * (UNKNOWN - 1)), [0, 1 / (UNKNOWN - 1), 1]);
  } else if (values && ends) colourBy(state, layer, values, ends);
  else layer.colour(0, null, PLAIN);
}

/** Colour a layer by values; until they are unpacked, as unknown. */
function colourBy(state: State, layer: Layer, values: Values, { from, to }: Ends): void {
  const numbers = (layer.numbers ?? state.numbers).get(values) ?? null;
  const all = kindsOf(state, values.key);
  let { low, step } = values;
  if (values.categories) {
    // The places among the kinds of all clouds; where another cloud has amounts, the values in 16 bits of their range.
    const kinds = values.categories;
    [low, step] = [kinds[0]!, (kinds.at(-1)! - kinds[0]!) / (UNKNOWN - 1)];
    const places = kinds.map((kind) => all ? all.indexOf(kind) : (kind - low) / (step || 1));
    layer.colour(all ? 2 : 0, numbers && numbers.map((i) => places[i] ?? UNKNOWN), scaleOf(values.root, low, step, from, to));
  } else layer.colour(0, numbers, scaleOf(values.root, low, step, from, to));
}

function scaleOf(root: boolean, low: number, step: number, from: number, to: number): [number, number, number] {
  return [(from - low) / (step || 1), (step || 1) / (to - from || 1), root ? 0.5 : 1];
}

function colourDistances(state: State, ends: Ends): void {
  const { clouds, layers, original, copies, views } = state;
  const base = layers[original]!;
  base.colour(0, null, PLAIN);
  clouds.forEach((cloud, i) => {
    const values = valuesFor(base.cloud, `${DISTANCE}:${i}`);
    if (cloud.role !== "result" || !values) return;
    if (!copies.has(i)) {
      const copy = new Layer(base.cloud, base.arrays, base.frame);
      copies.set(i, copy);
      views.add(copy.points);
    }
    colourBy(state, copies.get(i)!, values, ends);
  });
}

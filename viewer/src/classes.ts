// Values that are kinds, such as classes, and which of them are shown.
import { shown, UNKNOWN } from "./data";
import type { Layer } from "./scene";
import type { State } from "./state";

const CLASSIFICATION = "attribute:classification";
/** Return the different values of a quantity in all clouds if they are kinds rather than amounts. */
export function kindsOf({ clouds }: State, key: string): number[] | null {
  const found = clouds.flatMap(({ values }) => values.filter((each) => each.key === key));
  if (found.length === 0 || found.some(({ categories }) => !categories)) return null;
  return [...new Set(found.flatMap(({ categories }) => categories!))].sort((a, b) => a - b);
}

/** Return what the legend calls a kind. */
export function nameOf({ described }: State, key: string, kind: number): string {
  const name = key === CLASSIFICATION ? described.classes[kind] : "";
  return name ? `${shown(kind)} ${name}` : shown(kind);
}

/** Show or hide some kinds. */
export function showKinds(state: State, key: string, kinds: number[], on: boolean): void {
  const off = new Set(state.hidden.get(key));
  for (const kind of kinds) if (on) off.delete(kind); else off.add(kind);
  const hidden = new Map(state.hidden);
  if (off.size > 0) hidden.set(key, off); else hidden.delete(key);
  state.change({ hidden });
}

/** Let the layers hide the points of the kinds that are not shown, unless they do. */
export function hideKinds(state: State): void {
  const { hidden, layers, copies, numbers } = state;
  const filtered = JSON.stringify([copies.size, numbers.size, [...hidden].map(([key, kinds]) => [key, ...kinds])]);
  if (filtered === state.filtered) return;
  state.filtered = filtered;
  const nodes = layers.flatMap(({ octree }) => octree?.loaded ?? []);
  for (const layer of [...layers, ...nodes, ...copies.values()]) hideIn(state, layer);
}

/** Let a layer hide the points of the kinds that are not shown. */
export function hideIn({ hidden, numbers }: State, layer: Layer): void {
  const { values, shown: n } = layer.cloud;
  const off = hidden.size > 0 ? new Uint8Array(n) : null;
  for (const each of values) {
    const kinds = hidden.get(each.key);
    const held = (layer.numbers ?? numbers).get(each);
    if (!off || !kinds || !held || !each.categories) continue;
    const gone = each.categories.map((kind) => kinds.has(kind));
    for (let i = 0; i < n; i++) if (held[i] !== UNKNOWN && gone[held[i]!]) off[i] = 1;
  }
  layer.hide(off);
}

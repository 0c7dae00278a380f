// The point that was picked, and its values.
import { valuesFor } from "./colouring";
import { coordinates, shown, UNKNOWN, type Cloud, type Values } from "./data";
import { byId, element } from "./dom";
import type { CloudView, Place, State } from "./state";

const REACH = 14; // pixels from a click to the point that it picks
const MOVED = 0xffffffff; // stands for the row of the original of a point that is at none of its places

/** Pick the point at a place of the canvas. */
export function pick(state: State, x: number, y: number): void {
  state.change({ picked: pointAt(state, x, y) });
}

/** Return the point that is seen at a place of the canvas. */
export function pointAt({ current, views, clouds }: State, x: number, y: number): Place | null {
  const view = current.find((each) => isInside(each, x, y));
  const index = view ? views.pick(view, x, y, REACH) : null;
  return index === null ? null : { cloud: clouds.indexOf(view!.layer.cloud), index };
}

/** Return whether a view draws at a place of the canvas. */
export function isInside({ place, from, to }: CloudView, x: number, y: number): boolean {
  const { left, top, width, height } = place;
  return x >= left + from * width && x < left + to * width && y >= top && y < top + height;
}

/** Tell the values of the point. */
export function tell(state: State): void {
  const box = byId("picked");
  box.hidden = !state.picked;
  if (!state.picked) return box.replaceChildren();
  const list = element("dl");
  for (const [name, value] of rowsOf(state, state.picked)) list.append(element("dt", name), element("dd", value));
  const close = element("button", "×", { type: "button", className: "plain", ariaLabel: "Close" });
  close.addEventListener("click", () => state.change({ picked: null }));
  const told = element("div");
  told.append(element("b", state.clouds[state.picked.cloud]!.name), close, list);
  // Told again only if it is new: a screen reader reads it out.
  if (told.textContent !== box.textContent) box.replaceChildren(...told.childNodes);
}

function rowsOf(state: State, { cloud: number, index: chosen }: Place): [string, string][] {
  const [layer, index] = state.layers[number]!.part(chosen);
  const { cloud: each, arrays: { rows: order, originals, colours } } = layer;
  const numbers = layer.numbers ?? state.numbers;
  const row = order[index]!;
  const rows: [string, string][] = [["row", row.toLocaleString("en")]];
  if (each.role === "result") {
    rows.push(["chosen", `number ${(row + 1).toLocaleString("en")} of ${each.points.toLocaleString("en")}`]);
    rows.push(["why", reasonOf(each, index, numbers)]);
  }
  if (originals) {
    const from = originals[index]!;
    rows.push(["row in the original", from === MOVED ? "none: this point was moved" : from.toLocaleString("en")]);
  }
  coordinates(each, layer.arrays, index).forEach((at, axis) => rows.push(["xyz"[axis]!, shown(at, 6)]));
  if (colours) rows.push(["RGB", colours.slice(3 * index, 3 * index + 3).join(" ")]);
  for (const values of each.values.filter((some) => numbers.has(some))) {
    const value = valueAt(values, index, numbers);
    rows.push([values.title, value === null ? "unknown" : shown(value)]);
  }
  return rows;
}

/** Return a value of a point; null if it is unknown. */
function valueAt(values: Values, index: number, numbers: State["numbers"]): number | null {
  const number = numbers.get(values)?.[index] ?? UNKNOWN;
  if (number === UNKNOWN) return null;
  return values.categories ? values.categories[number]! : values.low + values.step * number;
}

/** Return in plain words why a point of a result was chosen. */
function reasonOf(cloud: Cloud, index: number, numbers: State["numbers"]): string {
  const [score, deviation] = ["score", "deviation"].map((name) => {
    const values = valuesFor(cloud, `attribute:${name}`);
    return values ? valueAt(values, index, numbers) : null;
  });
  if (score != null && deviation != null)
    return `the surface was most uncertain here (deviation ${shown(deviation, 3)} of the prior one)`;
  return cloud.reason ?? "the file does not say; gppcs simplify --scores writes it (method gp)";
}

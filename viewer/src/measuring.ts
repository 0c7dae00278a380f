// The distance between two points that are clicked.
import { coordinates, shown } from "./data";
import { byId, element } from "./dom";
import { pointAt } from "./picking";
import type { State } from "./state";

/** Take the point at a place of the canvas as the next end of the distance; a third point starts anew. */
export function measure(state: State, x: number, y: number): void {
  const place = pointAt(state, x, y);
  if (place) state.change({ measured: [...(state.measured.length < 2 ? state.measured : []), place] });
}

/** Return how far it is from the first point to the second along each axis, if there are two. */
function stepsOf({ measured, layers }: State): number[] | null {
  const [from, to] = measured.map(({ cloud, index }) => {
    const [layer, i] = layers[cloud]!.part(index);
    return coordinates(layer.cloud, layer.arrays, i);
  });
  return from && to ? to.map((end, axis) => end - from[axis]!) : null;
}

/** Return the distance in words; empty as long as there are no two points. */
export function distanceOf(state: State): string {
  const steps = stepsOf(state);
  return steps ? `${shown(Math.hypot(...steps), 5)} ${state.described.unit}`.trim() : "";
}

/** Tell the distance. */
export function tellDistance(state: State): void {
  const box = byId("measured");
  box.hidden = !state.measuring;
  const steps = stepsOf(state)?.map((step, axis) => `${"xyz"[axis]} ${shown(step, 5)}`);
  const asked = state.measured.length === 1 ? "Click the second point." : "Click two points to measure their distance.";
  const [text, parts] = steps ? [`Distance ${distanceOf(state)}`, `along ${steps.join(", ")}`] : [asked, ""];
  if (box.textContent !== text + parts) box.replaceChildren(element("b", text), element("span", parts));
}

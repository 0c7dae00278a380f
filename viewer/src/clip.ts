// The clip box: only what lies in it is shown.
import { Vector3 } from "three";
import { byId, element } from "./dom";
import { shown } from "./data";
import type { Frame } from "./scene";
import { WHOLE, type State } from "./state";

const ENDS = ["from", "to"] as const;

/** Offer the ends of the box. */
export function fillClip(state: State): void {
  const rows = [..."xyz"].map((axis, i) => {
    const row = element("div", "", { className: "row" });
    const inputs = ENDS.map((end, side) => {
      const input = element("input", "", { type: "range", min: "0", max: "1000", id: `${axis}${end}` });
      input.ariaLabel = `${axis} ${end}`;
      input.addEventListener("input", () => move(state, i, side, Number(input.value) / 1000));
      return input;
    });
    row.append(element("b", axis), ...inputs, element("output", "", { id: `${axis}ends` }));
    return row;
  });
  const all = element("button", "Show all", { type: "button", className: "plain" });
  all.addEventListener("click", () => state.change({ clip: WHOLE }));
  byId("clip").append(...rows, all);
}

/** Move an end of the box along an axis; the other end gives way. */
function move(state: State, axis: number, side: number, to: number): void {
  const ends = [...state.clip[axis]!] as [number, number];
  ends[side] = to;
  ends[1 - side] = side === 0 ? Math.max(to, ends[1]) : Math.min(to, ends[0]);
  state.change({ clip: state.clip.map((each, i) => i === axis ? ends : each) });
}

/** Show the box in its panel, and let the layers draw what lies in it. */
export function showClip({ clipping, clip, layers, copies, described }: State): void {
  byId("clip").hidden = !clipping;
  const { centre, half } = layers[0]!.frame;
  [..."xyz"].forEach((axis, i) => {
    ENDS.forEach((end, side) => { byId<HTMLInputElement>(`${axis}${end}`).value = String(1000 * clip[i]![side]!); });
    const places = clip[i]!.map((share) => described.together
      ? shown(centre[i]! + (2 * share - 1) * half[i]!) : `${Math.round(100 * share)} %`);
    byId(`${axis}ends`).textContent = places.join(" to ");
  });
  for (const { clip: { low, high }, frame } of [...layers, ...copies.values()]) {
    const [lowest, highest] = boxOf(frame, clipping ? clip : WHOLE);
    low.copy(lowest);
    high.copy(highest);
    // The ends at the frame's box hold what lies beyond it, too.
    clip.forEach(([from, to], i) => {
      if (!clipping || from === 0) low.setComponent(i, -1e9);
      if (!clipping || to === 1) high.setComponent(i, 1e9);
    });
  }
}

/** Return the lower and the upper corner of the box in a frame. */
function boxOf({ half, size }: Frame, clip: State["clip"]): [Vector3, Vector3] {
  const corner = (side: 0 | 1) => new Vector3(...half.map((each, i) => (2 * clip[i]![side] - 1) * each / size));
  return [corner(0), corner(1)];
}

/** Return the twelve edges of the box in a frame. */
export function edgesOf(frame: Frame, clip: State["clip"]): [Vector3, Vector3][] {
  const corners = boxOf(frame, clip);
  const at = (bits: number) => new Vector3(...[0, 1, 2].map((axis) => corners[(bits >> axis) & 1]!.getComponent(axis)));
  return [0, 1, 2].flatMap((axis) => [0, 1, 2, 3].map((pair): [Vector3, Vector3] => {
    const low = pair & ((1 << axis) - 1) | (pair >> axis) << (axis + 1); // the other two axes' bits
    return [at(low), at(low | (1 << axis))];
  }));
}

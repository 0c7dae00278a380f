// What lies over the pictures: rings around points, the line between two of them, and the edges of the clip box.
import type { Vector3 } from "three";
import { edgesOf } from "./clip";
import { byId, element } from "./dom";
import { drawn } from "./figures";
import { distanceOf } from "./measuring";
import { isInside } from "./picking";
import type { CloudView, Place, State } from "./state";

/** Put all marks where they are now. */
export function placeMarks(state: State): void {
  const { current, swiping, clipping, clip, picked, measured } = state;
  const marks: Element[] = [];
  current.forEach((view, i) => {
    const points = [...(picked ? [picked] : []), ...measured].filter((point) => lies(state, point, view));
    for (const point of points) marks.push(...ringOf(state, point, view));
    if (swiping && i === 1) return; // both clouds are in one view, which has the lines by now
    const lines = linesIn(view);
    if (clipping) for (const ends of edgesOf(view.layer.frame, clip)) draw(state, view, ends, "edge", lines);
    if (measured.length === 2 && measured.every((point) => lies(state, point, view)))
      draw(state, view, measured.map((point) => placeOf(state, point)), "distance", lines, distanceOf(state));
    if (lines.hasChildNodes()) marks.push(lines);
  });
  byId("marks").replaceChildren(...marks);
}

function placeOf({ layers }: State, { cloud, index }: Place): Vector3 {
  return layers[cloud]!.place(index);
}

/** Return whether a point lies in the frame of a view. */
function lies({ described, clouds }: State, point: Place, { layer }: CloudView): boolean {
  return described.together || clouds[point.cloud] === layer.cloud;
}

function ringOf(state: State, point: Place, view: CloudView): Element[] {
  const { x, y, z } = state.views.project(view, placeOf(state, point));
  if (!isInside(view, x, y) || Math.abs(z) > 1) return [];
  const ring = element("i", "", { className: "ring" });
  ring.style.cssText = `left:${x}px;top:${y}px`;
  return [ring];
}

/** Return a drawing over a view. */
function linesIn({ place: { left, top, width, height } }: CloudView): SVGElement {
  const lines = drawn("svg", { class: "lines" });
  lines.style.cssText = `left:${left}px;top:${top}px;width:${width}px;height:${height}px`;
  return lines;
}

/** Draw a line between two places of a frame, with a text at its middle. */
function draw(
  { views }: State, view: CloudView, ends: readonly Vector3[], kind: string, lines: SVGElement, text = "",
): void {
  const [from, to] = ends.map((end) => views.project(view, end)) as [Vector3, Vector3];
  if (Math.abs(from.z) > 1 || Math.abs(to.z) > 1) return; // behind the camera
  const { left, top } = view.place;
  const places = { x1: from.x - left, y1: from.y - top, x2: to.x - left, y2: to.y - top };
  lines.append(drawn("line", { ...places, class: kind }));
  if (text) lines.append(drawn("text", { x: (places.x1 + places.x2) / 2 + 8, y: (places.y1 + places.y2) / 2 - 6 }, text));
}

// Where the views stand, and their labels.
import { DISTANCE } from "./colouring";
import { byId, element } from "./dom";
import { worded } from "./figures";
import type { Layer, Rectangle } from "./scene";
import type { CloudView, State } from "./state";

const GAP = 6; // pixels between views

/** Lay out the views and label them. */
export function arrange(state: State): void {
  const { swiping, divider, views } = state;
  const holder = byId("views");
  const chosen = swiping ? [state.left, state.right] : [...state.shown].sort((a, b) => a - b);
  const { columns, across, tall, height } = gridFor(swiping ? 1 : chosen.length, holder.clientWidth);
  const place = (i: number): Rectangle => ({
    left: (i % columns) * (across + GAP), top: Math.floor(i / columns) * (tall + GAP), width: across, height: tall,
  });
  state.current = chosen.map((cloud, i) => ({
    cloud, layer: layerOf(state, cloud), place: place(swiping ? 0 : i),
    from: swiping && i === 1 ? divider : 0, to: swiping && i === 0 ? divider : 1,
  }));
  holder.style.height = `${height}px`;
  holder.style.setProperty("--swipe", `${100 * divider}%`);
  holder.classList.toggle("swiping", swiping);
  byId("labels").replaceChildren(...state.current.map((view, i) => labelOf(state, view, swiping && i === 1)));
  views.views = state.current;
  views.resize(holder.clientWidth, height);
}

/** Return the number of columns for some views, the size of each view, and the height of all. */
function gridFor(number: number, width: number): { columns: number; across: number; tall: number; height: number } {
  const columns = Math.min(Math.max(1, Math.floor(width / 300)), [1, 2, 3, 2, 3, 3][number - 1] ?? 4);
  const rows = Math.ceil(number / columns);
  const across = (width - GAP * (columns - 1)) / columns;
  const tallest = Math.max(260, window.innerHeight - 330);
  const tall = Math.round(Math.min(rows === 1 ? tallest : Math.max(220, tallest / rows), across * 1.1));
  return { columns, across, tall, height: rows * tall + GAP * (rows - 1) };
}

/** Return the layer that shows a cloud: for distances the original, which is coloured by its distance to the cloud. */
function layerOf(state: State, cloud: number): Layer {
  const copy = state.colouring === DISTANCE && !isSolid(state, cloud) ? state.copies.get(cloud) : undefined;
  return copy ?? state.layers[cloud]!;
}

/** Return whether the surface of a cloud is shown in place of its points. */
function isSolid({ meshes, layers }: State, cloud: number): boolean {
  return meshes && layers[cloud]!.mesh !== null;
}

function labelOf(state: State, { cloud, place, from, to }: CloudView, atEnd: boolean): HTMLElement {
  const box = element("div", "", { className: atEnd ? "label end" : "label" });
  const left = place.left + (state.swiping ? 0 : from * place.width);
  box.style.cssText = `left:${left}px;top:${place.top}px;width:${place.width}px;height:${place.height}px`;
  box.hidden = from === to;
  box.append(element("b", state.clouds[cloud]!.name), ...linesOf(state, cloud).map((line) => element("span", line)));
  return box;
}

/** Return what a label says below the name of a cloud. */
function linesOf(state: State, number: number): string[] {
  const { role, points, mesh, prefixes } = state.clouds[number]!;
  if (isSolid(state, number)) return [`${mesh!.triangles.toLocaleString("en")} triangles`];
  const visible = role === "original" ? points : Math.min(points, state.first);
  const lines = [`${visible.toLocaleString("en")} points`];
  const figure = state.described.figures.find(({ name }) => name === "surface_mean");
  const prefix = prefixes.filter((each) => each.points <= visible).at(-1);
  if (figure && prefix) {
    const cut = prefix.points < visible ? `first ${prefix.points.toLocaleString("en")}: ` : "";
    lines.push(`${cut}mean error ${worded(figure, prefix)}`);
  }
  if (state.colouring === DISTANCE && role === "result") lines.push("points of the original");
  return lines;
}

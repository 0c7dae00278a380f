// Where the views stand, and their labels.
import { DISTANCE } from "./colouring";
import { byId, element } from "./dom";
import { worded } from "./figures";
import type { Layer, Rectangle } from "./scene";
import type { CloudView, State } from "./state";

const GAP = 6; // pixels between views
const LEGEND = 135; // pixels for a legend of usual height, and around it
const MARGINS = 35; // pixels between the parts of the page, which the full screen does not have

/** Lay out the views and label them. */
export function arrange(state: State): void {
  const { swiping, divider, views } = state;
  const holder = byId("views");
  const chosen = swiping ? [state.left, state.right] : sideBySide(state);
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

/** Return the clouds that stand side by side. By distances, the view of each result shows the original, so that needs none. */
function sideBySide({ shown, colouring, original }: State): number[] {
  const clouds = [...shown].sort((a, b) => a - b);
  return colouring === DISTANCE && clouds.length > 1 ? clouds.filter((cloud) => cloud !== original) : clouds;
}

/** Return the number of columns for some views, the size of each view, and the height of all. */
function gridFor(number: number, width: number): { columns: number; across: number; tall: number; height: number } {
  const columns = Math.min(Math.max(1, Math.floor(width / 300)), [1, 2, 3, 2, 3, 3][number - 1] ?? 4);
  const rows = Math.ceil(number / columns);
  const across = (width - GAP * (columns - 1)) / columns;
  const tallest = Math.max(260, window.innerHeight - heightBeside());
  const tall = Math.round(Math.min(rows === 1 ? tallest : Math.max(220, tallest / rows), across * 1.1));
  return { columns, across, tall, height: rows * tall + GAP * (rows - 1) };
}

/** Return how many pixels the rest of the page, or of the full screen, takes above and below the views. */
function heightBeside(): number {
  const heights = (...ids: string[]) => ids.reduce((sum, id) => sum + byId(id).offsetHeight, LEGEND);
  return document.fullscreenElement ? heights("tools") : heights("head", "tools", "keys") + MARGINS;
}

/** Return the layer that shows a cloud: for distances the original, which is coloured by its distance to the cloud. */
function layerOf(state: State, cloud: number): Layer {
  const copy = state.colouring === DISTANCE ? state.copies.get(cloud) : undefined;
  return copy ?? state.layers[cloud]!;
}

function labelOf(state: State, view: CloudView, atEnd: boolean): HTMLElement {
  const { layer, place, from, to } = view;
  const box = element("div", "", { className: atEnd ? "label end" : "label" });
  const left = place.left + (state.swiping ? 0 : from * place.width);
  box.style.cssText = `left:${left}px;top:${place.top}px;width:${place.width}px;height:${place.height}px`;
  box.hidden = from === to;
  box.append(element("b", layer.cloud.name), ...linesOf(state, view).map((line) => element("span", line)));
  return box;
}

/** Return what a label says below the name of a cloud. */
function linesOf(state: State, { cloud, layer }: CloudView): string[] {
  const { name, prefixes } = state.clouds[cloud]!;
  const { role, points, mesh, counted } = layer.cloud;
  const visible = role === "original" ? points : Math.min(points, state.first);
  const triangles = state.meshes && layer.isSolid ? `, ${mesh!.triangles.toLocaleString("en")} triangles` : "";
  const lines = [`${visible.toLocaleString("en")} ${counted}${triangles}`];
  const isCopy = layer !== state.layers[cloud];
  if (isCopy) lines.push(`coloured by the distance to ${name}`);
  // Distances are those to all points of a result.
  const prefix = prefixes.filter((each) => isCopy || each.points <= visible).at(-1);
  const { figures } = state.described;
  const [largest, mean] = ["surface_max", "surface_mean"].map((each) => figures.find((figure) => figure.name === each));
  if (largest && mean && prefix) {
    const cut = !isCopy && prefix.points < visible ? `first ${prefix.points.toLocaleString("en")}: ` : "";
    lines.push(`${cut}largest error ${worded(largest, prefix)}, mean ${worded(mean, prefix)}`);
  }
  return lines;
}

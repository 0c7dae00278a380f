// Where the views stand, and their labels.
import { DISTANCE } from "./colouring";
import { byId, element } from "./dom";
import { length } from "./figures";
import type { Layer } from "./scene";
import type { CloudView, State } from "./state";

const GAP = 6; // pixels between views
const LEGEND = 135; // pixels for a legend of usual height, and around it
const MARGINS = 35; // pixels between the parts of the page, which the full screen does not have
const LINE = 30; // pixels of a label of one line, above its view
const ROOM = 1.08; // around what is seen, as a multiple of its size
const NEARLY = 1.15; // more columns are better if what is seen becomes less than this factor smaller

/** Lay out the views, each below its label. */
export function arrange(state: State): void {
  const { swiping, divider, views } = state;
  const holder = byId("views");
  const chosen = swiping ? [state.left, state.right] : sideBySide(state);
  const { columns, across, tall } = gridFor(swiping ? 1 : chosen.length, holder.clientWidth, state.shape);
  state.current = chosen.map((cloud, i) => ({
    cloud, layer: layerOf(state, cloud), place: { left: 0, top: 0, width: across, height: tall },
    from: swiping && i === 1 ? divider : 0, to: swiping && i === 0 ? divider : 1,
  }));
  holder.style.setProperty("--swipe", `${100 * divider}%`);
  holder.classList.toggle("swiping", swiping);
  const labels = state.current.map((view, i) => labelOf(state, view, swiping && i === 1));
  byId("labels").replaceChildren(...labels);
  const above = Math.max(...labels.map((label) => (label.firstChild as HTMLElement).offsetHeight));
  state.current.forEach(({ place }, i) => {
    const [column, row] = swiping ? [0, 0] : [i % columns, Math.floor(i / columns)];
    place.left = column * (across + GAP);
    place.top = row * (above + tall + GAP) + above;
    labels[i]!.style.cssText = `left:${place.left}px;top:${place.top - above}px;width:${across}px;height:${above + tall}px`;
  });
  const last = state.current.at(-1)!.place;
  holder.style.height = `${last.top + tall}px`;
  views.views = state.current;
  views.resize(holder.clientWidth, last.top + tall);
}

/** Return the clouds that stand side by side. By distances, the view of each result shows the original, so that needs none. */
function sideBySide({ shown, colouring, original }: State): number[] {
  const clouds = [...shown].sort((a, b) => a - b);
  return colouring === DISTANCE && clouds.length > 1 ? clouds.filter((cloud) => cloud !== original) : clouds;
}

/** Return in how many columns what is seen, of a shape, is largest, and the size of the views. */
function gridFor(number: number, width: number, shape: number): { columns: number; across: number; tall: number } {
  const free = Math.max(260, window.innerHeight - heightBeside());
  const grids = Array.from({ length: Math.min(number, 4, Math.max(1, Math.floor(width / 300))) }, (_, i) => {
    const columns = i + 1;
    const rows = Math.ceil(number / columns);
    const across = (width - GAP * (columns - 1)) / columns;
    const most = (rows === 1 ? free : Math.max(220, free / rows)) - LINE;
    return { columns, across, most, seen: Math.min(across, most * shape) };
  });
  const { columns, across, most } = grids.reduce((best, grid) => NEARLY * grid.seen >= best.seen ? grid : best);
  const tall = document.fullscreenElement ? most : Math.min(most, Math.max(160, across / shape * ROOM));
  return { columns, across, tall: Math.round(tall) };
}

/** Return how many pixels the rest of the page, or of the full screen, takes above and below the views. */
function heightBeside(): number {
  const heights = (...ids: string[]) => ids.reduce((sum, id) => sum + byId(id).offsetHeight, LEGEND);
  return document.fullscreenElement ? heights("tools") : heights("head", "tools") + MARGINS;
}

/** Return the layer that shows a cloud: for distances the original, which is coloured by its distance to the cloud. */
function layerOf(state: State, cloud: number): Layer {
  const copy = state.colouring === DISTANCE ? state.copies.get(cloud) : undefined;
  return copy ?? state.layers[cloud]!;
}

function labelOf(state: State, view: CloudView, atEnd: boolean): HTMLElement {
  const box = element("div", "", { className: atEnd ? "label end" : "label" });
  box.style.width = `${view.place.width}px`;
  box.hidden = view.from === view.to;
  const text = element("div");
  text.append(element("b", view.layer.cloud.name), ...linesOf(state, view).flatMap((line) => [" ", element("span", line)]));
  box.append(text);
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
  if (prefix) {
    const [mean, largest] = ["surface_mean", "surface_max"].map((figure) => length(figure, prefix, state.described.unit));
    const cut = !isCopy && prefix.points < visible ? `first ${prefix.points.toLocaleString("en")}: ` : "";
    lines.push(`${cut}mean error ${mean!.replace(" of the diagonal", "")}, largest ${largest}`);
  }
  return lines;
}

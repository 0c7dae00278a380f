// The page: unpacks the clouds, then shows what the state says, anew after each change.
import { hideIn, hideKinds } from "./classes";
import { fillClip, showClip } from "./clip";
import { colourNode, recolour } from "./colouring";
import { fillControls, listen, reset, showControls } from "./controls";
import { arraysOf, description, trianglesOf, valuesOf, type Cloud, type Description, type Values } from "./data";
import { byId, element } from "./dom";
import { fillFigures, fillMade, showPlot } from "./figures";
import { arrange } from "./layout";
import { fillLegend } from "./legend";
import { placeMarks } from "./marks";
import { tellDistance } from "./measuring";
import { Octree } from "./octree";
import { tell } from "./picking";
import { Layer, Views, type Frame } from "./scene";
import { State } from "./state";

async function start(): Promise<void> {
  const described = description();
  fillHead(described);
  const layers: Layer[] = [];
  for (const cloud of described.clouds) layers.push(new Layer(cloud, await arraysOf(cloud), frameOf(cloud, described)));
  const views = new Views(byId<HTMLCanvasElement>("canvas"), () => placeMarks(state));
  const state = new State(described, layers, views, redraw);
  for (const layer of layers) {
    const { octree } = layer.cloud;
    views.add(layer.points);
    if (octree) layer.octree = new Octree(layer, octree, views, (node) => {
      colourNode(state, node);
      hideIn(state, node);
    });
  }
  fillControls(state);
  fillClip(state);
  await unpackValues(state, ({ key }) => key === state.colouring);
  byId("page").hidden = false;
  byId("message").remove();
  fillMade(described.made);
  fillFigures(described);
  listen(state);
  state.redraw();
  reset(state);
  new ResizeObserver(() => state.redraw()).observe(byId("views"));
  await nextPicture();
  await unpackRest(state);
  document.documentElement.dataset["state"] = "ready";
}

/** Let everything on the page show the state. */
function redraw(state: State): void {
  const { views, shading, size, meshes, up, layers, first } = state;
  Object.assign(views, { shading, size, meshes });
  for (const layer of layers) if (layer.cloud.role !== "original") layer.limit = first;
  views.turn(up);
  recolour(state);
  hideKinds(state);
  showClip(state);
  arrange(state);
  showControls(state);
  fillLegend(state);
  tell(state);
  tellDistance(state);
  showPlot(state.described, state.plotted);
  views.draw();
}

function fillHead({ title, lead, notes }: Description): void {
  document.title = `${title} · gppcs`;
  byId("title").textContent = title;
  byId("lead").textContent = lead;
  byId("notes").append(...notes.map((note) => element("li", note)));
  byId("notes").hidden = notes.length === 0;
}

/** Return the frame of a cloud: that of all clouds, or its own if they are shown for themselves. */
function frameOf(cloud: Cloud, { clouds, together }: Description): Frame {
  const original = clouds.filter(({ role }) => role === "original");
  const boxed = !together ? [cloud] : original.length > 0 ? original : clouds;
  const ends = [0, 1, 2].map((axis) => [
    Math.min(...boxed.map(({ low }) => low[axis]!)),
    Math.max(...boxed.map(({ low, step }) => low[axis]! + 65535 * step[axis]!)),
  ] as const);
  const each = (of: (low: number, high: number) => number) =>
    ends.map(([low, high]) => of(low, high)) as [number, number, number];
  const half = each((low, high) => (high - low) / 2);
  return { centre: each((low, high) => (low + high) / 2), half, size: 2 * Math.hypot(...half) || 1 };
}

/** Unpack some of the values that colours can show. */
async function unpackValues({ clouds, numbers }: State, wanted: (values: Values) => boolean): Promise<void> {
  for (const cloud of clouds)
    for (const values of cloud.values) if (wanted(values)) numbers.set(values, await valuesOf(cloud, values));
}

/** Unpack what the first picture does not need, while it is seen. */
async function unpackRest(state: State): Promise<void> {
  await unpackValues(state, (values) => !state.numbers.has(values));
  for (const layer of state.layers) {
    const { mesh } = layer.cloud;
    if (mesh) state.views.add(layer.addMesh(mesh, await trianglesOf(mesh)));
  }
  state.coloured = ""; // surfaces have no colours yet
  state.redraw(); // by now somebody may have chosen another colouring, or a point
}

function nextPicture(): Promise<void> {
  return new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
}

start().catch((error: unknown) => {
  const message = byId("message") ?? document.body.appendChild(element("p", "", { className: "message" }));
  message.textContent = `The points cannot be shown: ${error instanceof Error ? error.message : String(error)}. ` +
    "This page needs a browser of 2023 or later with WebGL 2.";
  document.documentElement.dataset["state"] = "failed";
  console.error(error);
});

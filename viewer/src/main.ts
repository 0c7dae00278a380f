// The page: settings, views, the slider over the ranking, and the point that was picked.
import { gradient, KINDS, UNKNOWN_COLOUR } from "./colours";
import { arraysOf, description, shown, trianglesOf, UNKNOWN, valuesOf, type Cloud, type Values } from "./data";
import { element, fillMade, fillTable, measured, plot, worded } from "./figures";
import { Layer, Views, type Frame, type View } from "./scene";

const GAP = 6; // pixels between views
const CLICK = 4; // pixels that the pointer may move in a click
const REACH = 14; // pixels from a click to the point that it picks
const ORDER = "order"; // the colouring by order of choice, RGB and distance, which no single list of values holds
const RGB = "rgb";
const DISTANCE = "distance";

const described = description();
const { clouds } = described;
const byId = <T extends HTMLElement>(id: string) => document.getElementById(id) as T;
const select = (id: string) => byId<HTMLSelectElement>(id);
const original = clouds.findIndex(({ role }) => role === "original");
const ranked = clouds.filter(({ role }) => role !== "original");
const longest = Math.max(...ranked.map(({ points }) => points));
const numbers = new Map<Values, Uint16Array>();
const shownClouds = new Set(clouds.map((_, i) => i));
const layers: Layer[] = [];
const copies = new Map<number, Layer>(); // of the original, coloured by its distance to each result
let views: Views;
let up = described.up;
let swiping = false;
let selected: { cloud: number; index: number } | null = null;

async function start(): Promise<void> {
  document.title = `${described.title} · gppcs`;
  byId("title").textContent = described.title;
  byId("lead").textContent = described.lead;
  byId("notes").append(...described.notes.map((note) => element("li", note)));
  byId("notes").hidden = described.notes.length === 0;
  for (const cloud of clouds) layers.push(new Layer(cloud, await arraysOf(cloud), frameOf(cloud)));
  fillSettings();
  const first = select("colouring").value;
  await unpackValues((values) => values.key === first);
  byId("page").hidden = false;
  byId("message").remove();
  views = new Views(byId<HTMLCanvasElement>("canvas"), placeMarks);
  layers.forEach(({ points }) => views.add(points));
  fillMade(described.made);
  if (measured(clouds).length > 0) fillFigures();
  listen();
  views.turn(up);
  recolour();
  count();
  arrange();
  views.look(described.azimuth, described.elevation);
  new ResizeObserver(arrange).observe(byId("views"));
  await nextPicture();
  await unpackRest(first);
  document.documentElement.dataset["state"] = "ready";
}

/** Unpack some of the values that colours can show. */
async function unpackValues(wanted: (values: Values) => boolean): Promise<void> {
  for (const cloud of clouds)
    for (const values of cloud.values) if (wanted(values)) numbers.set(values, await valuesOf(cloud, values));
}

/** Unpack what the first picture does not need, while it is seen. */
async function unpackRest(first: string): Promise<void> {
  await unpackValues((values) => !numbers.has(values));
  for (const layer of layers) {
    const { mesh } = layer.cloud;
    if (mesh) views.add(layer.addMesh(mesh, await trianglesOf(mesh)));
  }
  byId("solids").hidden = !layers.some(({ mesh }) => mesh);
  // By now somebody may have chosen another colouring, or a point.
  if (select("colouring").value !== first) recolour();
  tell();
}

function nextPicture(): Promise<void> {
  return new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
}

/** Return the frame of a cloud: that of all clouds, or its own if they are shown for themselves. */
function frameOf(cloud: Cloud): Frame {
  const boxed = described.together ? (original < 0 ? clouds : [clouds[original]!]) : [cloud];
  const ends = [0, 1, 2].map((axis) => [
    Math.min(...boxed.map(({ low }) => low[axis]!)),
    Math.max(...boxed.map(({ low, step }) => low[axis]! + 65535 * step[axis]!)),
  ] as const);
  const size = Math.hypot(...ends.map(([low, high]) => high - low)) || 1;
  return { centre: ends.map(([low, high]) => (low + high) / 2) as [number, number, number], size };
}

function fillSettings(): void {
  const colouring = select("colouring");
  const add = (value: string, text: string) => colouring.append(new Option(text, value));
  for (const { key, title } of distinct(clouds.flatMap(({ values }) => values)))
    if (!key.startsWith(`${DISTANCE}:`)) add(key, title);
  if (clouds.some(({ values }) => values.some((each) => isOf(each, DISTANCE))))
    add(DISTANCE, "distance of the original to the result");
  add(ORDER, original < 0 ? "order in the file" : "order of choice");
  if (clouds.some(({ blocks }) => blocks.colours)) add(RGB, "RGB");
  for (const axis of "xyz") byId("up").append(element("button", "", { type: "button", value: axis }));
  for (const id of ["left", "right"]) clouds.forEach(({ name }, i) => select(id).append(new Option(name, String(i))));
  select("left").value = String(Math.max(0, Math.min(original, clouds.length - 1)));
  select("right").value = String(clouds.length - 1);
  byId("layouts").hidden = clouds.length < 2;
  byId("chips").hidden = clouds.length < 2;
  clouds.forEach(({ name }, i) => {
    const chip = element("button", name, { type: "button" });
    chip.addEventListener("click", () => {
      if (shownClouds.has(i) && shownClouds.size > 1) shownClouds.delete(i);
      else shownClouds.add(i);
      arrange();
    });
    byId("chips").append(chip);
  });
  byId("countname").textContent = original < 0 ? "First points of each file:" : "First points of each result:";
  byId("ranking").hidden = ranked.length === 0;
}

function distinct(values: Values[]): Values[] {
  return [...new Map(values.map((each) => [each.key, each])).values()];
}

function fillFigures(): void {
  fillTable(described);
  byId("figures").hidden = false;
  byId("figurestext").textContent =
    `Lengths are in ${described.lengths}; d is the diagonal of the original's bounding box, ` +
    `${shown(described.diagonal)}. The best value of each row is marked.`;
  const plotted = select("plotted");
  for (const { name, title, better } of described.figures) if (better) plotted.append(new Option(title, name));
  if (described.figures.some(({ name }) => name === "surface_mean")) plotted.value = "surface_mean";
  plotted.addEventListener("change", drawPlot);
  byId("plottext").textContent =
    "Each line is one result, cut after fewer and fewer of its points. Shorter results are real ones only where the " +
    "order of the points is a ranking, as for gp, fps, random, sample-elimination and top-variation.";
  byId("plots").hidden = false;
}

function drawPlot(): void {
  const figure = described.figures.find(({ name }) => name === select("plotted").value)!;
  plot(figure, clouds, Math.min(900, byId("plot").clientWidth));
}

function listen(): void {
  const canvas = byId<HTMLCanvasElement>("canvas");
  select("colouring").addEventListener("change", recolour);
  select("shading").addEventListener("change", () => { views.shading = select("shading").value; views.draw(); });
  const size = byId<HTMLInputElement>("size");
  size.addEventListener("input", () => { views.size = 2 ** Number(size.value); views.draw(); });
  byId("count").addEventListener("input", count);
  byId("points").addEventListener("click", () => solidify(false));
  byId("meshes").addEventListener("click", () => solidify(true));
  byId("side").addEventListener("click", () => swipe(false));
  byId("swipe").addEventListener("click", () => swipe(true));
  for (const id of ["left", "right"]) select(id).addEventListener("change", arrange);
  byId("divider").addEventListener("input", arrange);
  byId("reset").addEventListener("click", reset);
  for (const button of byId("up").querySelectorAll("button"))
    button.addEventListener("click", () => raise(up === button.value ? `-${up}` : button.value));
  raise(up);
  let pressed: [number, number] | null = null;
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) <= CLICK) {
      const box = canvas.getBoundingClientRect();
      choose(event.clientX - box.left, event.clientY - box.top);
    }
    pressed = null;
  });
  canvas.addEventListener("keydown", press);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => views.draw());
}

function press(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const move = event.shiftKey
    ? (x: number, y: number) => views.shift(0.04 * x, 0.04 * y)
    : (x: number, y: number) => views.orbit(0.08 * x, 0.08 * y);
  const actions: Record<string, () => void> = {
    ArrowLeft: () => move(-1, 0), ArrowRight: () => move(1, 0), ArrowUp: () => move(0, 1), ArrowDown: () => move(0, -1),
    "+": () => views.zoom(0.9), "=": () => views.zoom(0.9), "-": () => views.zoom(1 / 0.9), "0": reset,
    c: nextColouring, u: () => raise(UPS[(UPS.indexOf(up) + 1) % UPS.length]!),
    s: () => { if (clouds.length > 1) swipe(!swiping); }, Escape: () => choose(null),
    m: () => { if (!byId("solids").hidden) solidify(!views.meshes); },
  };
  const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action) return;
  event.preventDefault();
  action();
}

const UPS = ["x", "-x", "y", "-y", "z", "-z"];

function raise(axis: string): void {
  const changed = axis !== up;
  up = axis;
  for (const button of byId("up").querySelectorAll("button")) {
    const pressed = button.value === up.at(-1);
    button.setAttribute("aria-pressed", String(pressed));
    button.textContent = pressed && up.startsWith("-") ? `−${button.value}` : button.value;
  }
  views.turn(up);
  if (changed) reset();
}

function reset(): void {
  views.look(described.azimuth, described.elevation);
}

function nextColouring(): void {
  const colouring = select("colouring");
  colouring.selectedIndex = (colouring.selectedIndex + 1) % colouring.options.length;
  recolour();
}

/** Show surfaces in place of points, where there are some, or points. */
function solidify(on: boolean): void {
  views.meshes = on;
  byId("points").setAttribute("aria-pressed", String(!on));
  byId("meshes").setAttribute("aria-pressed", String(on));
  arrange();
}

function swipe(on: boolean): void {
  swiping = on;
  byId("side").setAttribute("aria-pressed", String(!on));
  byId("swipe").setAttribute("aria-pressed", String(on));
  byId("pair").hidden = byId("divider").hidden = !on;
  byId("chips").hidden = on || clouds.length < 2;
  arrange();
  reset();
}

/** Return the layer that shows a cloud: for distances the original, which is coloured by its distance to the cloud. */
function layerOf(cloud: number): Layer {
  if (solid(cloud)) return layers[cloud]!;
  return (select("colouring").value === DISTANCE && copies.get(cloud)) || layers[cloud]!;
}

/** Return whether the surface of a cloud is shown in place of its points. */
function solid(cloud: number): boolean {
  return views.meshes && layers[cloud]!.mesh !== null;
}

/** Lay out the views. */
function arrange(): void {
  const holder = byId("views");
  const width = holder.clientWidth;
  const chosen = [...shownClouds].sort((a, b) => a - b);
  const columns = swiping ? 1 : columnsFor(chosen.length, width);
  const rows = swiping ? 1 : Math.ceil(chosen.length / columns);
  const across = (width - GAP * (columns - 1)) / columns;
  const tallest = Math.max(260, window.innerHeight - 330);
  const tall = Math.round(Math.min(rows === 1 ? tallest : Math.max(220, tallest / rows), across * 1.1));
  holder.style.height = `${rows * tall + GAP * (rows - 1)}px`;
  const place = (number: number) => ({
    left: (number % columns) * (across + GAP), top: Math.floor(number / columns) * (tall + GAP),
    width: across, height: tall,
  });
  if (swiping) {
    const at = Number(byId<HTMLInputElement>("divider").value) / 1000;
    const half = (id: string, from: number, to: number): View & { cloud: number } => {
      const cloud = Number(select(id).value);
      return { cloud, layer: layerOf(cloud), place: place(0), from, to };
    };
    current = [half("left", 0, at), half("right", at, 1)];
    holder.style.setProperty("--swipe", `${100 * at}%`);
  } else {
    current = chosen.map((cloud, i) => ({ cloud, layer: layerOf(cloud), place: place(i), from: 0, to: 1 }));
  }
  holder.classList.toggle("swiping", swiping);
  views.views = current;
  for (const [i, chip] of [...byId("chips").children].entries()) chip.setAttribute("aria-pressed", String(shownClouds.has(i)));
  label();
  views.resize(width, rows * tall + GAP * (rows - 1));
  if (!byId("plots").hidden) drawPlot();
}

let current: (View & { cloud: number })[] = [];

function columnsFor(number: number, width: number): number {
  const most = Math.max(1, Math.floor(width / 300));
  const even = [1, 2, 3, 2, 3, 3][number - 1] ?? 4;
  return Math.min(most, even);
}

function label(): void {
  byId("labels").replaceChildren(...current.map(({ cloud, place, from, to }, i) => {
    const { name, role, points } = clouds[cloud]!;
    const visible = role === "original" ? points : Math.min(points, limit());
    const box = element("div", "", { className: swiping && i === 1 ? "label end" : "label" });
    box.style.cssText = `left:${place.left + (swiping ? 0 : from * place.width)}px;top:${place.top}px;width:${
      place.width}px;height:${place.height}px`;
    box.hidden = from === to;
    box.append(element("b", name));
    if (solid(cloud)) {
      box.append(element("span", `${clouds[cloud]!.mesh!.triangles.toLocaleString("en")} triangles`));
      return box;
    }
    box.append(element("span", `${visible.toLocaleString("en")} points`));
    const figure = described.figures.find((each) => each.name === "surface_mean");
    const prefix = clouds[cloud]!.prefixes.filter((each) => each.points <= visible).at(-1);
    if (figure && prefix) {
      const cut = prefix.points < visible ? `first ${prefix.points.toLocaleString("en")}: ` : "";
      box.append(element("span", `${cut}mean error ${worded(figure, prefix)}`));
    }
    if (select("colouring").value === DISTANCE && role === "result")
      box.append(element("span", "points of the original"));
    return box;
  }));
}

/** Return the number of points of each result that the slider shows; the slider is logarithmic. */
function limit(): number {
  const at = Number(byId<HTMLInputElement>("count").value) / 1000;
  return Math.max(1, Math.round(longest ** at));
}

function count(): void {
  const text = limit() < longest ? limit().toLocaleString("en") : "all";
  byId("counted").textContent = text;
  byId("count").setAttribute("aria-valuetext", `${text} points`);
  layers.forEach((layer) => { if (layer.cloud.role !== "original") layer.limit = limit(); });
  label();
  views.draw();
}

/** Return the values of a cloud that the chosen colouring shows. */
function valuesFor(cloud: Cloud, key: string): Values | undefined {
  return cloud.values.find((values) => values.key === key);
}

function recolour(): void {
  const key = select("colouring").value;
  if (key === DISTANCE) {
    colourDistances();
  } else {
    const all = endsOf(key);
    for (const layer of layers) {
      const { cloud, arrays } = layer;
      const values = valuesFor(cloud, key);
      if (key === RGB) layer.colour(arrays.colours ? 1 : 0, null, [0, 1, 1]);
      else if (key === ORDER && cloud.role !== "original") {
        const last = Math.max(1, cloud.points - 1);
        layer.colour(0, Uint16Array.from(arrays.rows, (row) => row / last * (UNKNOWN - 1)), [0, 1 / (UNKNOWN - 1), 1]);
      } else if (values && all) colourBy(layer, values, all);
      else layer.colour(0, null, [0, 1, 1]);
    }
    fillLegend(key, all);
  }
  arrange();
}

interface Ends {
  from: number;
  to: number;
  values: Values;
}

/** Return whether a colouring shows some values; that by distance shows the distances to all results. */
function isOf(values: Values, key: string): boolean {
  return key === DISTANCE ? values.key.startsWith(`${DISTANCE}:`) : values.key === key;
}

/** Return the ends of the colour scale of a quantity: of the original, or of all clouds if it has no such values. */
function endsOf(key: string): Ends | null {
  const of = (some: Cloud[]) => some.flatMap((cloud) => cloud.values.filter((values) => isOf(values, key)));
  const first = of(clouds.filter(({ role }) => role === "original"));
  const found = first.length > 0 ? first : of(clouds); // the original decides: results differ only by its sampling
  if (found.length === 0) return null;
  return { from: Math.min(...found.map((v) => v.from)), to: Math.max(...found.map((v) => v.to)), values: found[0]! };
}

function scaleOf(values: Values, { from, to }: Ends): [number, number, number] {
  const step = values.step || 1;
  return [(from - values.low) / step, step / (to - from || 1), values.root ? 0.5 : 1];
}

/** Colour a cloud by values; until they are unpacked, as unknown. */
function colourBy(layer: Layer, values: Values, ends: Ends): void {
  layer.colour(values.categories ? 2 : 0, numbers.get(values) ?? null, scaleOf(values, ends));
}

function colourDistances(): void {
  const all = endsOf(DISTANCE)!;
  const base = layers[original]!;
  base.colour(0, null, [0, 1, 1]);
  clouds.forEach((cloud, i) => {
    const values = valuesFor(clouds[original]!, `${DISTANCE}:${i}`);
    if (cloud.role !== "result" || !values) return;
    if (!copies.has(i)) {
      const copy = new Layer(base.cloud, base.arrays, base.frame);
      copies.set(i, copy);
      views.add(copy.points);
    }
    colourBy(copies.get(i)!, values, all);
  });
  fillLegend(DISTANCE, all);
}

function fillLegend(key: string, all: Ends | null): void {
  const scale = byId("scale");
  const name = byId("legendname");
  scale.replaceChildren();
  scale.className = "";
  if (key === RGB) {
    name.textContent = "RGB as in the file";
    return;
  }
  if (key === ORDER) {
    name.textContent = original < 0 ? "order in the file" : "order of choice, in the file of each result";
    bar(scale, ["first", "last"]);
    return;
  }
  if (!all) return;
  const { values, from, to } = all;
  name.textContent = (key === DISTANCE ? "distance of the original to the surface of the result" : values.title) +
    (values.unit ? `, ${values.unit}` : "");
  if (values.categories) {
    scale.className = "kinds";
    values.categories.forEach((kind, i) => {
      const entry = element("span", shown(kind));
      entry.style.setProperty("--kind", KINDS[i % KINDS.length]!);
      scale.append(entry);
    });
    return;
  }
  const middle = from + (to - from) * (values.root ? 0.25 : 0.5);
  bar(scale, [shown(from, 3), shown(middle, 3), `${shown(to, 3)}${clipped(key, to) ? " or more" : ""}`]);
}

/** Return whether some values lie above the end of the colour scale. */
function clipped(key: string, to: number): boolean {
  return clouds.some((cloud) => cloud.values.some((v) => isOf(v, key) && v.low + (UNKNOWN - 1) * v.step > to * (1 + 1e-9)));
}

function bar(scale: HTMLElement, texts: string[]): void {
  const band = element("div", "", { className: "band" });
  band.style.background = gradient();
  const row = element("div", "", { className: "ticks" });
  row.append(...texts.map((text) => element("span", text)));
  const unknown = element("span", "unknown", { className: "unknown" });
  unknown.style.setProperty("--kind", UNKNOWN_COLOUR);
  scale.append(band, row, unknown);
}

/** Choose the point at a place of the canvas; without a place, none. */
function choose(x: number | null, y = 0): void {
  selected = null;
  const view = x === null ? undefined : current.find(({ place, from, to }) =>
    x >= place.left + from * place.width && x < place.left + to * place.width && y >= place.top && y < place.top + place.height);
  if (view && x !== null) {
    const index = views.pick(view, x, y, REACH);
    if (index !== null) selected = { cloud: clouds.indexOf(view.layer.cloud), index };
  }
  tell();
  views.draw();
}

function tell(): void {
  const box = byId("picked");
  box.hidden = !selected;
  if (!selected) return;
  const { cloud, index } = selected;
  const each = clouds[cloud]!;
  const { arrays } = layers[cloud]!;
  const row = arrays.rows[index]!;
  const rows: [string, string][] = [["row", row.toLocaleString("en")]];
  if (each.role === "result") {
    rows.push(["chosen", `number ${(row + 1).toLocaleString("en")} of ${each.points.toLocaleString("en")}`]);
    rows.push(["why", reasonOf(each, index)]);
  }
  if (arrays.originals) rows.push(["row in the original", arrays.originals[index]! === 0xffffffff
    ? "none: this point was moved" : arrays.originals[index]!.toLocaleString("en")]);
  ["x", "y", "z"].forEach((axis, c) =>
    rows.push([axis, shown(each.low[c]! + each.step[c]! * arrays.positions[3 * index + c]!, 6)]));
  if (arrays.colours) rows.push(["RGB", [...arrays.colours.slice(3 * index, 3 * index + 3)].join(" ")]);
  for (const values of each.values.filter((some) => numbers.has(some))) {
    const value = valueAt(values, index);
    rows.push([values.title, value === null ? "unknown" : shown(value)]);
  }
  const list = element("dl");
  for (const [name, value] of rows) list.append(element("dt", name), element("dd", value));
  const close = element("button", "×", { type: "button", className: "plain", ariaLabel: "Close" });
  close.addEventListener("click", () => choose(null));
  box.replaceChildren(element("b", each.name), close, list);
}

/** Return a value of a point; null if it is unknown. */
function valueAt(values: Values, index: number): number | null {
  const number = numbers.get(values)![index]!;
  if (number === UNKNOWN) return null;
  return values.categories ? values.categories[number]! : values.low + values.step * number;
}

/** Return in plain words why a point of a result was chosen. */
function reasonOf(cloud: Cloud, index: number): string {
  const [score, deviation] = ["score", "deviation"].map((name) => {
    const values = valuesFor(cloud, `attribute:${name}`);
    return values ? valueAt(values, index) : null;
  });
  if (score != null && deviation != null)
    return `the surface was most uncertain here (deviation ${shown(deviation, 3)} of the prior one)`;
  return cloud.reason ?? "the file does not say; gppcs simplify --scores writes it (method gp)";
}

/** Put a ring around the chosen point in each view. */
function placeMarks(): void {
  const holder = byId("labels");
  holder.querySelectorAll(".ring").forEach((ring) => ring.remove());
  if (!selected) return;
  const { cloud, index } = selected;
  for (const view of current) {
    const place = views.project({ ...view, layer: layers[cloud]! }, index);
    const { left, top, width, height } = view.place;
    const inside = place.x > left + view.from * width && place.x < left + view.to * width && place.y > top && place.y < top + height;
    if (!inside || Math.abs(place.z) > 1) continue;
    const ring = element("i", "", { className: "ring" });
    ring.style.cssText = `left:${place.x}px;top:${place.y}px`;
    holder.append(ring);
  }
}

start().catch((error: unknown) => {
  const message = byId("message") ?? document.body.appendChild(element("p", "", { className: "message" }));
  message.textContent = `The points cannot be shown: ${error instanceof Error ? error.message : String(error)}. ` +
    "This page needs a browser of 2023 or later with WebGL 2.";
  document.documentElement.dataset["state"] = "failed";
  console.error(error);
});

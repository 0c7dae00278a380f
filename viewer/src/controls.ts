// The settings of the views: their elements, the pointer and the keys.
import { colourings, endsOf } from "./colouring";
import { byId, element } from "./dom";
import { measure } from "./measuring";
import { pick } from "./picking";
import { savePicture } from "./picture";
import type { State } from "./state";

const CLICK = 4; // pixels that the pointer may move in a click
const LEAST = 10; // the slider shows at least one point of so many
const DIRECTIONS: Record<string, [number, number]> = { top: [0, 90], front: [0, 0], side: [90, 0] }; // in degrees
const UPS = ["x", "-x", "y", "-y", "z", "-z"];

const select = (id: string) => byId<HTMLSelectElement>(id);
const input = (id: string) => byId<HTMLInputElement>(id);

/** Offer the settings that these clouds have. */
export function fillControls(state: State): void {
  const { clouds, original, described } = state;
  for (const [key, title] of colourings(state)) select("colouring").append(new Option(title, key));
  state.colouring = select("colouring").value;
  for (const axis of "xyz") byId("up").append(element("button", "", { type: "button", value: axis }));
  for (const id of ["left", "right"]) clouds.forEach(({ name }, i) => select(id).append(new Option(name, String(i))));
  byId("chips").append(...clouds.map(({ name }) => element("button", name, { type: "button" })));
  byId("swipe").hidden = byId("clouds").hidden = clouds.length < 2;
  byId("full").hidden = !document.fullscreenEnabled;
  byId("countname").textContent = original < 0 ? "First points of each file:" : "First points of each result:";
  byId("ranking").hidden = state.longest < 1;
  for (const { name, title, better } of described.figures) if (better) select("plotted").append(new Option(title, name));
  state.plotted = "surface_mean";
}

/** Let the elements show the settings. */
export function showControls(state: State): void {
  const press = (element: Element, on: boolean) => element.setAttribute("aria-pressed", String(on));
  const { up, meshes, swiping, first, longest, measuring, clipping } = state;
  for (const id of ["colouring", "shading", "left", "right", "plotted"] as const) select(id).value = String(state[id]);
  for (const button of byId("up").querySelectorAll("button")) {
    const isUp = button.value === up.at(-1);
    press(button, isUp);
    button.textContent = isUp && up.startsWith("-") ? `−${button.value}` : button.value;
  }
  press(byId("points"), !meshes);
  press(byId("meshes"), meshes);
  press(byId("swipe"), swiping);
  press(byId("measuring"), measuring);
  press(byId("clipping"), clipping);
  press(byId("full"), document.fullscreenElement !== null);
  byId("canvas").classList.toggle("measuring", measuring);
  [...byId("chips").children].forEach((chip, i) => press(chip, state.shown.has(i)));
  byId("solids").hidden = !hasMeshes(state);
  byId("pair").hidden = byId("divider").hidden = byId("grip").hidden = !swiping;
  byId("clouds").hidden = swiping || state.clouds.length < 2;
  const text = first < longest ? `${first.toLocaleString("en")} (${Math.round(100 * first / longest)} %)` : "all";
  byId("counted").textContent = text;
  byId("count").ariaValueText = `${text} points`;
}

/** Change the settings as the elements, the pointer and the keys say. */
export function listen(state: State): void {
  const on = (id: string, event: string, changed: () => void) => byId(id).addEventListener(event, changed);
  const share = (id: string) => Number(input(id).value) / 1000;
  for (const id of ["colouring", "shading", "plotted"])
    on(id, "change", () => state.change({ [id]: select(id).value }));
  for (const id of ["left", "right"]) on(id, "change", () => state.change({ [id]: Number(select(id).value) }));
  on("size", "input", () => state.change({ size: 2 ** Number(input("size").value) }));
  on("count", "input", () => state.change({ first: Math.ceil(state.longest * LEAST ** (share("count") - 1)) }));
  on("divider", "input", () => state.change({ divider: share("divider") }));
  on("points", "click", () => state.change({ meshes: false }));
  on("meshes", "click", () => state.change({ meshes: true }));
  on("swipe", "click", () => swipe(state, !state.swiping));
  on("reset", "click", () => reset(state));
  for (const direction of Object.keys(DIRECTIONS)) on(direction, "click", () => look(state, ...DIRECTIONS[direction]!));
  on("measuring", "click", () => toggleMeasuring(state));
  on("clipping", "click", () => state.change({ clipping: !state.clipping }));
  on("save", "click", () => savePicture(state));
  on("full", "click", fillScreen);
  document.addEventListener("fullscreenchange", () => state.redraw());
  on("from", "change", () => setRange(state, 0));
  on("to", "change", () => setRange(state, 1));
  on("fitted", "click", () => state.change({ ranges: without(state.ranges, state.colouring) }));
  for (const button of byId("up").querySelectorAll("button"))
    button.addEventListener("click", () => raise(state, state.up === button.value ? `-${button.value}` : button.value));
  [...byId("chips").children].forEach((chip, i) => chip.addEventListener("click", () => toggle(state, i)));
  listenToCanvas(state);
  listenToGrip(state);
  listenToMenus();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => state.redraw());
}

function listenToCanvas(state: State): void {
  const canvas = byId<HTMLCanvasElement>("canvas");
  let pressed: [number, number] | null = null;
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) <= CLICK) {
      const box = canvas.getBoundingClientRect();
      (state.measuring ? measure : pick)(state, event.clientX - box.left, event.clientY - box.top);
    }
    pressed = null;
  });
  canvas.addEventListener("keydown", (event) => press(state, event));
}

/** Let the divider be dragged wherever it is. */
function listenToGrip(state: State): void {
  const grip = byId("grip");
  grip.addEventListener("pointerdown", (event) => grip.setPointerCapture(event.pointerId));
  grip.addEventListener("pointermove", (event) => {
    if (!grip.hasPointerCapture(event.pointerId)) return;
    const { left, width } = byId("views").getBoundingClientRect();
    const divider = Math.min(1, Math.max(0, (event.clientX - left) / width));
    input("divider").value = String(1000 * divider);
    state.change({ divider });
  });
}

/** Close the menus on a press elsewhere, or on Escape. */
function listenToMenus(): void {
  const menus = document.querySelectorAll<HTMLDetailsElement>(".menu");
  document.addEventListener("pointerdown", ({ target }) => {
    for (const menu of menus) if (!menu.contains(target as Node)) menu.open = false;
  });
  for (const menu of menus) menu.addEventListener("keydown", ({ key }) => {
    if (key !== "Escape") return;
    menu.open = false;
    menu.querySelector("summary")!.focus();
  });
}

function press(state: State, event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const { views, up, swiping, meshes, clouds } = state;
  const move = event.shiftKey
    ? (x: number, y: number) => views.shift(0.04 * x, 0.04 * y)
    : (x: number, y: number) => views.orbit(0.08 * x, 0.08 * y);
  const actions: Record<string, () => void> = {
    ArrowLeft: () => move(-1, 0), ArrowRight: () => move(1, 0), ArrowUp: () => move(0, 1), ArrowDown: () => move(0, -1),
    "+": () => views.zoom(0.9), "=": () => views.zoom(0.9), "-": () => views.zoom(1 / 0.9), "0": () => reset(state),
    c: () => nextColouring(state), u: () => raise(state, UPS[(UPS.indexOf(up) + 1) % UPS.length]!),
    s: () => { if (clouds.length > 1) swipe(state, !swiping); }, Escape: () => drop(state),
    m: () => { if (hasMeshes(state)) state.change({ meshes: !meshes }); },
    1: () => look(state, ...DIRECTIONS["top"]!), 2: () => look(state, ...DIRECTIONS["front"]!),
    3: () => look(state, ...DIRECTIONS["side"]!), d: () => toggleMeasuring(state),
    b: () => state.change({ clipping: !state.clipping }), p: () => savePicture(state), f: fillScreen,
  };
  const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action) return;
  event.preventDefault();
  action();
}

/** Drop the picked point and the distance. */
function drop(state: State): void {
  state.change({ picked: null, measured: [], measuring: false });
}

function toggleMeasuring(state: State): void {
  state.change({ measuring: !state.measuring, measured: [], picked: null });
}

function fillScreen(): void {
  if (document.fullscreenElement) void document.exitFullscreen();
  else void byId("stage").requestFullscreen();
}

/** Set an end of the colour scale to what its field says. */
function setRange(state: State, end: 0 | 1): void {
  const { from, to } = endsOf(state, state.colouring)!;
  const range: [number, number] = [from, to];
  const field = input(end === 0 ? "from" : "to");
  range[end] = field.valueAsNumber;
  if (range[0] < range[1]) return state.change({ ranges: new Map([...state.ranges, [state.colouring, range]]) });
  field.setCustomValidity(`expected a number ${end === 0 ? `below ${to}` : `above ${from}`}`);
  field.reportValidity();
}

function without<T>(map: ReadonlyMap<string, T>, key: string): Map<string, T> {
  return new Map([...map].filter(([each]) => each !== key));
}

function nextColouring(state: State): void {
  const keys = colourings(state).map(([key]) => key);
  state.change({ colouring: keys[(keys.indexOf(state.colouring) + 1) % keys.length]! });
}

function raise(state: State, up: string): void {
  state.change({ up });
  reset(state);
}

function swipe(state: State, swiping: boolean): void {
  state.change({ swiping });
  reset(state);
}

/** Show or hide a cloud; one is always shown. */
function toggle(state: State, cloud: number): void {
  const others = [...state.shown].filter((each) => each !== cloud);
  const shown = state.shown.has(cloud) ? others : [...others, cloud];
  if (shown.length === 0) return;
  state.change({ shown: new Set(shown) });
  reset(state);
}

/** Look again as at the start. */
export function reset(state: State): void {
  look(state, state.described.azimuth, state.described.elevation);
}

/** Look from a direction, in degrees, in views of the shape of what is seen from there. */
function look(state: State, azimuth: number, elevation: number): void {
  state.change({ shape: state.views.shapeFrom(azimuth, elevation) });
  state.views.look(azimuth, elevation);
}

function hasMeshes({ layers }: State): boolean {
  return layers.some(({ mesh }) => mesh);
}

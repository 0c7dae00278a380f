// The table of figures, the plot of quality against number of points, and how the page was made.
import { KINDS } from "./colours";
import { shown, type Cloud, type Description, type Figure, type Prefix } from "./data";
import { byId, element } from "./dom";

const BESIDE = 2; // results at most whose figures stand beside the views of a wide page
const SVG = "http://www.w3.org/2000/svg";

/** Return the value of a figure with its unit; lengths in that of the file. */
function worded(figure: Figure, prefix: Prefix, unit: string): string {
  const value = prefix.figures[figure.name];
  if (value === undefined || value === null) return "–";
  if (figure.unit === "share") return `${shown(100 * value, 3)} %`;
  if (figure.unit === "degrees") return `${shown(value, 3)}°`;
  return figure.unit === "length" ? `${shown(value)} ${unit}`.trim() : shown(value);
}

/** Return a length in percent of the diagonal. */
function relatively(figure: Figure, prefix: Prefix): string {
  const value = prefix.relative[figure.name];
  if (figure.name === "diagonal" || value === undefined || value === null) return "";
  if (figure.unit === "length") return `${shown(100 * value, 3)} % of the diagonal`;
  return figure.unit === "squared length" ? `${shown(value, 3)} of the squared diagonal` : "";
}

/** Return a length in the unit of the file, or in percent of the diagonal if the file does not tell its unit. */
export function length(name: string, prefix: Prefix, unit: string): string {
  const { [name]: value } = unit ? prefix.figures : prefix.relative;
  return unit ? `${shown(value ?? NaN, 3)} ${unit}` : `${shown(100 * (value ?? NaN), 3)} % of the diagonal`;
}

function measured(clouds: Cloud[]): Cloud[] {
  return clouds.filter((cloud) => cloud.prefixes.length > 0);
}

/** Show the figures, if some were measured. */
export function fillFigures(described: Description): void {
  if (measured(described.clouds).length === 0) return;
  byId("verdicts").append(...measured(described.clouds).map((cloud) => verdictOn(cloud, described.unit)));
  fillTable(described);
  byId("figures").hidden = false;
  byId("plots").hidden = measured(described.clouds).every(({ prefixes }) => prefixes.length < 2);
  const results = measured(described.clouds).length;
  byId("page").classList.toggle("beside", results <= BESIDE);
  byId("figurestext").textContent =
    `Lengths are in ${described.unit || "the unit of the coordinates"}. The diagonal of the original's bounding box is ` +
    `${shown(described.diagonal)}.${results > 1 ? " The best value of each row is marked." : ""}`;
  byId("plottext").textContent =
    "Each line is one result, cut after fewer and fewer of its points. Shorter results are real ones only where the " +
    "order of the points is a ranking, as for gp, fps, random, sample-elimination, qem and top-variation.";
}

/** Say in a sentence how far the original is from a result. */
function verdictOn({ name, prefixes, counted }: Cloud, unit: string): HTMLElement {
  const lengthOf = (figure: string) => length(figure, prefixes.at(-1)!, unit);
  const said = element("li");
  said.append(
    element("b", name), ": no original point is farther than ", element("b", lengthOf("surface_max")),
    ` from ${counted === "vertices" ? "its surface" : "the surface through the kept points"} (surface max); 95 % are within ${lengthOf("surface_p95")} (surface p95).`,
  );
  return said;
}

/** Draw the plot of a figure, if some were measured. */
export function showPlot({ figures, clouds }: Description, name: string): void {
  if (!byId("plots").hidden) plot(figures.find((each) => each.name === name)!, clouds, Math.min(900, byId("plot").clientWidth));
}

function fillTable({ clouds, figures, unit }: Description): void {
  const results = measured(clouds);
  const last = (cloud: Cloud) => cloud.prefixes.at(-1)!;
  const head = element("tr");
  head.append(element("th", "Figure", { scope: "col" }));
  for (const cloud of results) head.append(element("th", cloud.name, { scope: "col" }));
  const body = element("tbody");
  for (const figure of figures) {
    const row = element("tr", "", { className: figure.first ? "" : "more" });
    const name = element("th", "", { scope: "row" });
    name.append(element("b", figure.title, { title: figure.definition }), element("span", figure.definition));
    row.append(name);
    const known = results.map((cloud) => last(cloud).figures[figure.name]).filter((v) => typeof v === "number");
    if (known.length === 0) continue;
    const best = figure.better === "more" ? Math.max(...known) : Math.min(...known);
    for (const cloud of results) {
      const cell = element("td", worded(figure, last(cloud), unit));
      const part = relatively(figure, last(cloud));
      if (part) cell.append(element("span", part));
      const distinct = new Set(known).size > 1;
      if (figure.better && distinct && last(cloud).figures[figure.name] === best) cell.className = "best";
      row.append(cell);
    }
    body.append(row);
  }
  const top = element("thead");
  top.append(head);
  byId("table").append(top, body);
  byId("all").addEventListener("click", () => {
    const all = byId("table").classList.toggle("all");
    byId("all").ariaExpanded = String(all);
    byId("all").textContent = all ? "Fewer figures" : "All figures";
  });
}

export function fillMade(made: [string, string][]): void {
  for (const [name, value] of made) {
    const row = byId<HTMLTableElement>("made").insertRow(), cell = element("td");
    for (const word of value.split(" ")) cell.append(element("span", word), " "); // lines end between words, not in --force
    row.append(element("th", name, { scope: "row" }), cell);
  }
}

export function drawn(tag: string, attributes: Record<string, string | number>, text = ""): SVGElement {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  if (text) made.textContent = text;
  return made;
}

/** Return round numbers between two ends: 1, 2 and 5 times powers of ten, at most about six. */
function ticks(low: number, high: number): number[] {
  const found: number[] = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
    for (const digit of [1, 2, 5]) {
      const value = Number(`${digit}e${power}`);
      if (value >= low && value <= high) found.push(value);
    }
  const every = Math.ceil(found.length / 6);
  return found.filter((_, i) => i % every === 0);
}

/** Draw a figure against the number of points, both on logarithmic axes. */
function plot(figure: Figure, clouds: Cloud[], width: number): void {
  const series = measured(clouds).map((cloud, number) => ({
    name: cloud.name,
    colour: KINDS[number % KINDS.length]!,
    places: cloud.prefixes
      .map((prefix) => [prefix.points, prefix.figures[figure.name] ?? 0] as const)
      .filter(([, value]) => value > 0),
  }));
  const all = series.flatMap(({ places }) => places);
  const holder = byId("plot");
  holder.replaceChildren();
  if (all.length === 0) {
    holder.append(element("p", "All values are 0 or unknown."));
    return;
  }
  const [left, bottom, top, height] = [64, 44, 14, 320];
  const right = Math.min(190, 0.28 * width);
  const ends = (axis: 0 | 1): [number, number] => {
    const values = all.map((place) => place[axis]);
    return [Math.min(...values) / 1.15, Math.max(...values) * 1.15];
  };
  const [xs, ys] = [ends(0), ends(1)];
  const along = (value: number, [low, high]: [number, number]) => Math.log(value / low) / Math.log(high / low);
  const x = (value: number) => left + along(value, xs) * (width - left - right);
  const y = (value: number) => height - bottom - along(value, ys) * (height - bottom - top);
  const picture = drawn("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img" });
  picture.setAttribute("aria-label", `${figure.title} against the number of points, for each result`);
  for (const value of ticks(...xs)) {
    picture.append(drawn("line", { x1: x(value), x2: x(value), y1: top, y2: height - bottom, class: "grid" }));
    picture.append(drawn("text", { x: x(value), y: height - bottom + 18, class: "middle" }, value.toLocaleString("en")));
  }
  for (const value of ticks(...ys)) {
    picture.append(drawn("line", { x1: left, x2: width - right, y1: y(value), y2: y(value), class: "grid" }));
    picture.append(drawn("text", { x: left - 8, y: y(value) + 4, class: "end" }, shown(value, 2)));
  }
  picture.append(drawn("text", { x: (left + width - right) / 2, y: height - 6, class: "middle name" }, "points kept"));
  const names: { at: number; text: string; colour: string }[] = [];
  for (const { name, colour, places } of series) {
    const path = places.map(([p, v]) => `${x(p).toFixed(1)},${y(v).toFixed(1)}`).join(" ");
    picture.append(drawn("polyline", { points: path, fill: "none", stroke: colour, "stroke-width": 2 }));
    for (const [p, v] of places) {
      const dot = drawn("circle", { cx: x(p), cy: y(v), r: 4, fill: colour });
      dot.append(drawn("title", {}, `${name}: ${shown(v)} with ${p.toLocaleString("en")} points`));
      picture.append(dot);
    }
    const end = places.at(-1);
    if (end) names.push({ at: y(end[1]), text: name, colour });
  }
  names.sort((a, b) => a.at - b.at);
  let free = top;
  for (const { at, text, colour } of names) {
    const place = Math.max(at + 4, free);
    free = place + 16;
    picture.append(drawn("rect", { x: width - right + 8, y: place - 8, width: 8, height: 8, rx: 2, fill: colour }));
    const most = Math.max(4, Math.floor((right - 24) / 7));
    const label = drawn("text", { x: width - right + 21, y: place }, text.length > most ? `${text.slice(0, most - 1)}…` : text);
    label.append(drawn("title", {}, text));
    picture.append(label);
  }
  holder.append(picture);
}

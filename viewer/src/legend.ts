// The legend of the colours: what they show, the ends of their scale, the kinds that are shown, and what grey means.
import { kindsOf, nameOf, showKinds } from "./classes";
import { DISTANCE, endsOf, isOf, ORDER, RGB, valuesFor, type Ends } from "./colouring";
import { gradient, kindColour, UNKNOWN_COLOUR } from "./colours";
import { shown, UNKNOWN, type Values } from "./data";
import { byId, element } from "./dom";
import type { CloudView, State } from "./state";

/** Say what the colours show. */
export function fillLegend(state: State): void {
  const { colouring } = state;
  const kinds = kindsOf(state, colouring);
  const ends = endsOf(state, colouring);
  byId("legendname").textContent = titleOf(state, ends);
  byId("amounts").hidden = colouring === RGB || kinds !== null;
  byId("band").style.background = gradient();
  fillAmounts(state, ends);
  byId("kinds").hidden = kinds === null;
  fillKinds(state, kinds ?? []);
  fillUnknown(state);
}

function titleOf({ colouring, original }: State, ends: Ends | null): string {
  if (colouring === RGB) return "RGB as in the file";
  if (colouring === ORDER) return original < 0 ? "order in the file" : "order of choice, in the file of each result";
  const title = colouring === DISTANCE ? "distance of the original to the surface of the result" : ends!.values.title;
  return ends!.values.unit ? `${title}, ${ends!.values.unit}` : title;
}

/** Show the ends of the scale: fields to change them, or words for an order. */
function fillAmounts(state: State, ends: Ends | null): void {
  const [least, most] = ends ? outermost(state) : [0, 0];
  const texts = ends ? [least < ends.from ? "or less" : "", most > ends.to ? "or more" : ""] : ["first", "last"];
  ["from", "to"].forEach((id, i) => {
    const field = byId<HTMLInputElement>(id);
    field.hidden = !ends;
    field.setCustomValidity("");
    if (ends) field.value = String(Number((i === 0 ? ends.from : ends.to).toPrecision(4)));
    byId(`${id}text`).textContent = texts[i]!;
  });
  byId("middle").textContent = ends ? shown(ends.from + (ends.to - ends.from) * (ends.values.root ? 0.25 : 0.5), 3) : "";
  byId("fitted").hidden = !state.ranges.has(state.colouring);
}

/** Return the least and the largest value that the colours show. */
function outermost({ clouds, colouring }: State): [number, number] {
  const found = clouds.flatMap(({ values }) => values).filter((values) => isOf(values, colouring));
  const most = ({ low, step }: Values) => (low + (UNKNOWN - 1) * step) * (1 - 1e-9);
  return [Math.min(...found.map(({ low }) => low)), Math.max(...found.map(most))];
}

/** Offer the kinds, each with its colour, to be shown or hidden. */
function fillKinds(state: State, kinds: number[]): void {
  const { colouring, hidden } = state;
  const holder = byId("kinds");
  const key = `${colouring} ${kinds}`;
  if (holder.dataset["key"] !== key) {
    holder.dataset["key"] = key;
    holder.replaceChildren(...kinds.map((kind, i) => entryOf(state, kind, i)), ...both(state, kinds));
  }
  holder.querySelectorAll("label").forEach((label, i) => {
    const on = !hidden.get(colouring)?.has(kinds[i]!);
    label.querySelector("input")!.checked = on;
    label.classList.toggle("off", !on);
  });
  const elsewhere = [...hidden.keys()].filter((each) => each !== colouring);
  byId("hiddenkinds").textContent = elsewhere.map((each) =>
    `Hidden: ${endsOf(state, each)!.values.title} ${[...hidden.get(each)!].map((kind) => nameOf(state, each, kind)).join(", ")}.`,
  ).join(" ");
}

function entryOf(state: State, kind: number, i: number): HTMLElement {
  const { colouring } = state;
  const label = element("label");
  const box = element("input", "", { type: "checkbox" });
  box.addEventListener("change", () => showKinds(state, colouring, [kind], box.checked));
  const swatch = element("i");
  swatch.style.background = `rgb(${kindColour(i).join(" ")})`;
  label.append(box, swatch, element("span", nameOf(state, colouring, kind)));
  return label;
}

function both(state: State, kinds: number[]): HTMLElement[] {
  const { colouring } = state;
  return kinds.length === 0 ? [] : [true, false].map((on) => {
    const button = element("button", on ? "all" : "none", { type: "button", className: "plain" });
    button.addEventListener("click", () => showKinds(state, colouring, kinds, on));
    return button;
  });
}

/** Say why points are grey, if some are. */
function fillUnknown(state: State): void {
  const reasons = [...new Set(state.current.flatMap((view) => whyGrey(state, view)))];
  byId("unknown").hidden = reasons.length === 0;
  byId("why").textContent = `grey: ${reasons.join("; ")}`;
  byId("unknown").style.setProperty("--kind", UNKNOWN_COLOUR);
}

const holdUnknown = new WeakMap<Values, boolean>();

function whyGrey({ colouring, numbers, layers }: State, { layer }: CloudView): string[] {
  const { cloud } = layer;
  if (colouring === RGB) return cloud.blocks.colours ? [] : [`${cloud.name} has no RGB`];
  if (colouring === ORDER) return cloud.role === "original" ? [`${cloud.name} is the original, without such an order`] : [];
  if (colouring === DISTANCE) return layers.includes(layer) ? [`${cloud.name} alone has no distance`] : [];
  const values = valuesFor(cloud, colouring);
  if (!values) return [`${cloud.name} has no such values`];
  const held = numbers.get(values);
  if (!held) return ["not unpacked yet"];
  if (!holdUnknown.has(values)) holdUnknown.set(values, held.includes(UNKNOWN));
  if (!holdUnknown.get(values)) return [];
  return [colouring === "variation" ? "unknown of fewer than four points" : "unknown, no number in the file"];
}

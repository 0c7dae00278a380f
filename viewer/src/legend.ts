// The legend of the colours.
import { DISTANCE, endsOf, isOf, ORDER, RGB } from "./colouring";
import { gradient, KINDS, UNKNOWN_COLOUR } from "./colours";
import { shown, UNKNOWN } from "./data";
import { byId, element } from "./dom";
import type { State } from "./state";

/** Say what the colours show. */
export function fillLegend(state: State): void {
  const [name, ...scale] = described(state);
  byId("legendname").textContent = name;
  byId("scale").replaceChildren(...scale);
}

/** Return what the colours show in words, and their scale. */
function described(state: State): [string, ...HTMLElement[]] {
  const { colouring, original } = state;
  if (colouring === RGB) return ["RGB as in the file"];
  if (colouring === ORDER) {
    const name = original < 0 ? "order in the file" : "order of choice, in the file of each result";
    return [name, bar("first", "last")];
  }
  const { values, from, to } = endsOf(state, colouring)!;
  const title = colouring === DISTANCE ? "distance of the original to the surface of the result" : values.title;
  const name = values.unit ? `${title}, ${values.unit}` : title;
  if (values.categories) return [name, kinds(values.categories)];
  const middle = from + (to - from) * (values.root ? 0.25 : 0.5);
  return [name, bar(shown(from, 3), shown(middle, 3), `${shown(to, 3)}${isClipped(state, to) ? " or more" : ""}`)];
}

/** Return whether some values lie above the end of the colour scale. */
function isClipped({ clouds, colouring }: State, to: number): boolean {
  const highest = clouds.flatMap(({ values }) => values).filter((values) => isOf(values, colouring))
    .map(({ low, step }) => low + (UNKNOWN - 1) * step);
  return Math.max(...highest) > to * (1 + 1e-9);
}

function bar(...texts: string[]): HTMLElement {
  const band = element("div", "", { className: "band" });
  band.style.background = gradient();
  const ticks = element("div", "", { className: "ticks" });
  ticks.append(...texts.map((text) => element("span", text)));
  const unknown = element("span", "unknown", { className: "unknown" });
  unknown.style.setProperty("--kind", UNKNOWN_COLOUR);
  const whole = element("div");
  whole.append(band, ticks, unknown);
  return whole;
}

function kinds(categories: number[]): HTMLElement {
  const whole = element("div", "", { className: "kinds" });
  categories.forEach((kind, i) => {
    const entry = element("span", shown(kind));
    entry.style.setProperty("--kind", KINDS[i % KINDS.length]!);
    whole.append(entry);
  });
  return whole;
}

// A picture of the views, with their labels and the legend, to save.
import { ramp } from "./colours";
import { byId, element } from "./dom";
import type { State } from "./state";

const EDGE = 12; // pixels of the page around the legend

/** Save what the views show as a PNG. */
export function savePicture(state: State): void {
  const seen = state.views.picture();
  const ratio = seen.width / seen.clientWidth;
  const legend = byId("legend").getBoundingClientRect();
  const canvas = element("canvas", "", { width: seen.width, height: seen.height + ratio * (legend.height + 2 * EDGE) });
  const context = canvas.getContext("2d")!;
  context.fillStyle = getComputedStyle(document.body).backgroundColor;
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(seen, 0, 0);
  context.scale(ratio, ratio);
  const { left, top } = byId("views").getBoundingClientRect();
  context.translate(-left, -top);
  if (state.swiping) context.fillRect(left + state.divider * seen.clientWidth - 1, top, 2, seen.clientHeight);
  for (const lines of byId("marks").querySelectorAll("svg")) drawLines(context, lines);
  for (const ring of byId("marks").querySelectorAll(".ring")) drawRing(context, ring);
  drawTexts(context, byId("labels"));
  context.translate(left + EDGE - legend.left, top + seen.clientHeight + EDGE - legend.top);
  drawTexts(context, byId("legend"));
  canvas.toBlob((blob) => {
    const link = element("a", "", { href: URL.createObjectURL(blob!), download: `${state.described.title}.png` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000); // by then the browser has begun to save
  });
}

/** Draw the texts and the coloured areas of an element where they stand on the page. */
function drawTexts(context: CanvasRenderingContext2D, root: HTMLElement): void {
  context.textBaseline = "middle";
  for (const leaf of root.querySelectorAll<HTMLElement>(":not(:has(*), button, [type=checkbox], .off *)")) {
    const { left, top, width, height } = leaf.getBoundingClientRect();
    if (width === 0) continue; // hidden
    const { backgroundColor, color, textAlign, paddingLeft } = getComputedStyle(leaf);
    const inset = parseFloat(paddingLeft);
    const isField = leaf instanceof HTMLInputElement;
    context.fillStyle = leaf.id === "band" ? ramp(context, left, width) : backgroundColor;
    if (!isField) context.fillRect(left, top, width, height);
    const atEnd = textAlign === "right" || textAlign === "end";
    context.textAlign = atEnd ? "right" : "left";
    [context.font, context.fillStyle] = [fontOf(leaf), color];
    context.fillText(isField ? leaf.value : leaf.textContent!, atEnd ? left + width - inset : left + inset, top + height / 2);
  }
}

function fontOf(each: Element): string {
  const { fontWeight, fontSize, fontFamily } = getComputedStyle(each);
  return `${fontWeight} ${fontSize} ${fontFamily}`;
}

function drawLines(context: CanvasRenderingContext2D, lines: SVGElement): void {
  const { left, top } = lines.getBoundingClientRect();
  for (const line of lines.querySelectorAll("line")) {
    const [x1, y1, x2, y2] = ["x1", "y1", "x2", "y2"].map((name) => Number(line.getAttribute(name)));
    context.beginPath();
    context.moveTo(left + x1!, top + y1!);
    context.lineTo(left + x2!, top + y2!);
    const { stroke, strokeWidth } = getComputedStyle(line);
    [context.strokeStyle, context.lineWidth] = [stroke, parseFloat(strokeWidth)];
    context.stroke();
  }
  for (const text of lines.querySelectorAll("text")) {
    [context.font, context.fillStyle] = [fontOf(text), getComputedStyle(text).fill];
    context.fillText(text.textContent!, left + Number(text.getAttribute("x")), top + Number(text.getAttribute("y")));
  }
}

function drawRing(context: CanvasRenderingContext2D, ring: Element): void {
  const { left, top, width, height } = ring.getBoundingClientRect();
  context.beginPath();
  context.arc(left + width / 2, top + height / 2, width / 2, 0, 2 * Math.PI);
  context.strokeStyle = getComputedStyle(ring).outlineColor;
  context.lineWidth = 2;
  context.stroke();
}

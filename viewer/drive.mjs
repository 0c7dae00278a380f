// Uses pages as a person would, and prints what was seen as JSON: node drive.mjs BROWSER REPORT VIEW
// REPORT is a page of a cloud and two results with meshes, VIEW one of a scene with classes.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [executablePath, report, view] = process.argv.slice(2);
const quiet = ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run"];
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", ...quiet];
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const browser = await chromium.launch({ executablePath, args });
const seen = { messages: [], requests: [] };

async function opened(page, width, height, colorScheme) {
  const tab = await browser.newPage({ viewport: { width, height }, colorScheme });
  tab.on("console", (message) => { if (message.type() === "error") seen.messages.push(message.text()); });
  tab.on("pageerror", (error) => seen.messages.push(error.message));
  tab.on("request", (request) => { if (request.url() !== tab.url() && !/^(file|data|blob):/.test(request.url())) seen.requests.push(request.url()); });
  await tab.goto(pathToFileURL(page).href);
  await tab.waitForFunction(() => document.documentElement.dataset.state, null, { timeout: 120_000 });
  await settled(tab);
  return tab;
}

/** Wait until the views stand still and all points are drawn. */
async function settled(tab) {
  await tab.waitForTimeout(400);
  await tab.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/** Return where the views are, each below its label. */
function places(tab) {
  return tab.locator(".label").evaluateAll((labels) => labels.map((label) => {
    const above = label.firstChild.offsetHeight;
    return [label.offsetLeft, label.offsetTop + above, label.offsetWidth, label.offsetHeight - above];
  }));
}

/** Click a button of the menu. */
async function choose(tab, button) {
  await tab.locator("#more summary").click();
  await tab.locator(button).click();
  await tab.locator("#more summary").click();
}

/**
 * Return for each view what is drawn, that is, differs from the background: the share of its pixels, the box around them
 * in shares of the view, the share of pinholes beside them, and a digest of all pixels. The outermost pixels are left out.
 */
async function pictures(tab) {
  await settled(tab);
  const hidden = "#labels, #marks, #picked, #divider, #grip, .panels { visibility: hidden } .views { border-radius: 0 } #canvas { outline: none }";
  let [png, before] = ["", null];
  while (png !== before) { // a slow machine draws coarse pictures first
    before = png;
    png = (await tab.locator("#canvas").screenshot({ style: hidden })).toString("base64");
    if (png !== before) await tab.waitForTimeout(250);
  }
  const views = await places(tab);
  return tab.evaluate(async ([data, places]) => {
    const bitmap = await createImageBitmap(new Blob([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return places.map((place) => {
      const [left, top, width, height] = [place[0] + 2, place[1] + 2, place[2] - 4, place[3] - 4];
      const pixels = context.getImageData(left, top, width, height).data;
      const first = 4 * ((height - 20) * width + 20);
      const isDrawn = new Uint8Array(width * height);
      const box = { left: width, top: height, right: 0, bottom: 0 };
      let [drawn, holes, digest] = [0, 0, 7];
      for (let i = 0; i < width * height; i++) {
        let apart = 0;
        for (let c = 0; c < 3; c++) {
          apart += Math.abs(pixels[4 * i + c] - pixels[first + c]);
          digest = (Math.imul(digest, 31) + pixels[4 * i + c]) | 0;
        }
        if (apart <= 30) continue;
        isDrawn[i] = 1;
        drawn++;
        const [x, y] = [i % width, Math.floor(i / width)];
        [box.left, box.right] = [Math.min(box.left, x), Math.max(box.right, x + 1)];
        [box.top, box.bottom] = [Math.min(box.top, y), Math.max(box.bottom, y + 1)];
      }
      for (let i = 2 * width; i < width * (height - 2); i++)
        if (!isDrawn[i] && isDrawn[i - 2] && isDrawn[i + 2] && isDrawn[i - 2 * width] && isDrawn[i + 2 * width]) holes++;
      return {
        share: drawn / (width * height), holes: holes / drawn, digest,
        box: [box.left / width, box.top / height, box.right / width, box.bottom / height],
        shape: (box.right - box.left) / (box.bottom - box.top),
      };
    });
  }, [png, views]);
}

async function accessible(tab) {
  await tab.evaluate(axe);
  const found = await tab.evaluate(() => window.axe.run());
  return found.violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html).join(" ")}`);
}

const labels = (tab) => tab.locator(".label").evaluateAll((all) =>
  all.map((label) => [...label.querySelectorAll("b, span")].map((part) => part.textContent).join("\n")));
const tab = await opened(report, 1280, 900, "light");
seen.title = await tab.title();
seen.heading = await tab.locator("h1").innerText();
const solid = async () => ({
  pictures: await pictures(tab), labels: await labels(tab),
  pressed: await tab.locator("#meshes").getAttribute("aria-pressed"),
});
seen.opened = await solid();
await tab.locator("#points").click();
seen.start = await pictures(tab);
seen.labels = await labels(tab);
seen.colourings = {};
for (const option of await tab.locator("#colouring option").all()) {
  await tab.selectOption("#colouring", await option.getAttribute("value"));
  seen.colourings[await option.innerText()] = { pictures: await pictures(tab), labels: await labels(tab), legend: await tab.locator("#legend").innerText() };
}
await tab.selectOption("#colouring", { index: 0 });
await tab.locator("#count").fill("0");
seen.fewest = { labels: await labels(tab), text: await tab.locator("#counted").innerText() };
await tab.locator("#count").fill("500");
seen.fewer = { pictures: await pictures(tab), labels: await labels(tab) };
await tab.locator("#count").fill("1000");
const box = await tab.locator("#canvas").boundingBox();
await tab.mouse.move(box.x + 100, box.y + 200);
await tab.mouse.down();
await tab.mouse.move(box.x + 180, box.y + 230, { steps: 4 });
await tab.mouse.up();
seen.dragged = await pictures(tab);
await tab.locator("#reset").click();
seen.reset = await pictures(tab);
await tab.locator("#canvas").focus();
await tab.keyboard.press("ArrowLeft");
seen.turned = await pictures(tab);
await tab.keyboard.press("0");
await tab.keyboard.press("u");
seen.up = { pictures: await pictures(tab), text: await tab.locator("#up").textContent() };
for (let i = 0; i < 5; i++) await tab.keyboard.press("u");
seen.picked = [];
for (const [left, top, width, height] of await places(tab)) {
  await tab.keyboard.press("Escape");
  await tab.mouse.click(box.x + left + width / 2, box.y + top + height / 2);
  const rows = await tab.locator("#picked dl").evaluate((list) => [...list.querySelectorAll("dt")].map((dt) => [dt.textContent, dt.nextSibling.textContent]));
  await settled(tab);
  seen.picked.push({ name: await tab.locator("#picked b").innerText(), values: Object.fromEntries(rows), rings: await tab.locator(".ring").count() });
}
await tab.keyboard.press("Escape");
seen.hidden = await tab.locator("#picked").isHidden();
seen.directions = {};
for (const [key, id] of ["reset", "top", "front", "side"].entries()) {
  await (id === "reset" ? tab.locator("#reset").click() : choose(tab, `#${id}`));
  seen.directions[id] = await pictures(tab);
  await tab.locator("#canvas").focus();
  await tab.keyboard.press("ArrowLeft");
  await tab.keyboard.press(String(key));
  seen.directions[`${id} by key`] = await pictures(tab);
}
await tab.locator("#reset").click();
await tab.locator("#canvas").focus();
await tab.keyboard.press("s");
seen.swipe = { labels: await labels(tab), middle: await pictures(tab) };
await tab.locator("#divider").fill("200");
seen.swipe.left = await pictures(tab);
const grip = await tab.locator("#grip").boundingBox();
await tab.mouse.move(grip.x + grip.width / 2, grip.y + 10); // far from the knob
await tab.mouse.down();
await tab.mouse.move(box.x + 0.7 * box.width, grip.y + 30, { steps: 4 });
await tab.mouse.up();
seen.swipe.dragged = { divider: await tab.locator("#divider").inputValue(), pictures: await pictures(tab) };
await tab.locator("#swipe").click();
await tab.locator("#meshes").click();
seen.meshes = await solid();
await tab.selectOption("#colouring", "variation");
seen.meshes.coloured = await pictures(tab);
await tab.selectOption("#colouring", { index: 0 });
await tab.locator("#count").fill("500");
seen.meshes.fewer = await solid();
await tab.locator("#count").fill("1000");
await tab.locator("#points").click();
seen.points = await pictures(tab);
await tab.locator("#canvas").focus();
await tab.keyboard.press("m");
seen.meshes.again = await solid();
seen.verdicts = await tab.locator("#verdicts li").allInnerTexts();
const figures = async () => ({ rows: await tab.locator("#table tbody tr:visible").count(), text: await tab.locator("#table").innerText() });
seen.figures = { first: await figures() };
await tab.locator("#all").click();
seen.figures.all = await figures();
const tops = async (page) => new Set(await page.locator("#tools > :visible").evaluateAll((all) => all.map((each) => each.offsetTop + each.offsetHeight / 2)));
seen.toolRows = (await tops(tab)).size;
await tab.locator("#help summary").click();
seen.keys = { width: (await tab.locator("#keys").boundingBox()).width };
await tab.locator("h1").click();
seen.keys.left = await tab.locator("#keys").isVisible();
seen.plotted = await tab.locator("#plot circle").count();
seen.made = await tab.locator("#made").innerText();
seen.accessible = await accessible(tab);
const narrow = await opened(report, 400, 850, "dark");
seen.narrow = {
  width: await narrow.evaluate(() => document.documentElement.scrollWidth),
  pictures: await pictures(narrow),
  accessible: await accessible(narrow),
};
seen.backgrounds = await Promise.all([tab, narrow].map((each) => each.evaluate(() => getComputedStyle(document.body).backgroundColor)));

const scene = await opened(view, 1280, 720, "light");
let canvas = await scene.locator("#canvas").boundingBox();
seen.scene = { start: await pictures(scene), colouring: await scene.locator("#colouring").inputValue() };

seen.ranges = {};
await scene.selectOption("#colouring", "attribute:height");
const ranged = async () => ({
  pictures: await pictures(scene), from: await scene.locator("#from").inputValue(), to: await scene.locator("#to").inputValue(),
  legend: await scene.locator("#legend").innerText(), refused: await scene.locator("#from").evaluate((field) => field.validationMessage),
});
seen.ranges.start = await ranged();
for (const [id, value] of [["from", "1"], ["to", "2"], ["from", "3"]]) {
  await scene.locator(`#${id}`).fill(value);
  await scene.locator(`#${id}`).press("Enter");
  seen.ranges[`${id} ${value}`] = await ranged();
}
await scene.locator("#fitted").click();
seen.ranges.fitted = await ranged();

seen.classes = {};
await scene.selectOption("#colouring", "attribute:classification");
const classed = async () => ({ pictures: await pictures(scene), legend: await scene.locator("#legend").innerText() });
seen.classes.all = await classed();
await scene.locator("#kinds label", { hasText: "6 building" }).click();
seen.classes.some = await classed();
await scene.selectOption("#colouring", "rgb");
seen.classes.rgb = await classed();
await scene.selectOption("#colouring", "attribute:classification");
await scene.locator("#kinds button", { hasText: "none" }).click();
seen.classes.none = await classed();
await scene.locator("#kinds button", { hasText: "all" }).click();
seen.classes.again = await classed();

/** Return the coordinates of the point that a click at a place of the canvas picks. */
async function place(x, y) {
  await scene.mouse.click(canvas.x + x, canvas.y + y);
  const told = scene.locator("#picked dl");
  if (!await told.count()) return null;
  const rows = await told.evaluate((list) => [...list.querySelectorAll("dt")].map((dt) => [dt.textContent, dt.nextSibling.textContent]));
  return "xyz".split("").map((axis) => Number(new Map(rows).get(axis)));
}

const [one, other] = [[0.45, 0.5], [0.6, 0.6]].map(([x, y]) => [x * canvas.width, y * canvas.height]);
seen.distance = { places: [await place(...one), await place(...other)] };
await choose(scene, "#measuring");
seen.distance.asked = await scene.locator("#measured").innerText();
for (const [x, y] of [one, other]) await scene.mouse.click(canvas.x + x, canvas.y + y);
await settled(scene);
seen.distance.text = await scene.locator("#measured").innerText();
seen.distance.line = await scene.locator("#marks line.distance").evaluate((line) => {
  const { left, top } = line.ownerSVGElement.style;
  return [["x1", left], ["y1", top], ["x2", left], ["y2", top]].map(([name, from]) => Number(line.getAttribute(name)) + parseFloat(from));
});
seen.distance.clicks = [...one, ...other];
await scene.locator("#canvas").focus();
await scene.keyboard.press("Escape");
seen.distance.left = await scene.locator("#measured").isHidden();

await choose(scene, "#front");
canvas = await scene.locator("#canvas").boundingBox();
const whole = await pictures(scene);
await choose(scene, "#clipping");
await scene.locator("#xfrom").fill("500");
seen.clip = { whole, half: await pictures(scene), edges: await scene.locator("#marks line.edge").count(), text: await scene.locator("#xends").innerText() };
seen.clip.left = await place(0.25 * canvas.width, 0.6 * canvas.height);
seen.clip.right = await place(0.75 * canvas.width, 0.6 * canvas.height);
await scene.keyboard.press("Escape");
const waiting = scene.waitForEvent("download");
await scene.locator("#save").click();
const download = await waiting;
const saved = readFileSync(await download.path());
seen.saved = { name: download.suggestedFilename(), png: saved.toString("base64"), canvas: [canvas.width, canvas.height] };
await scene.locator("#canvas").focus();
await scene.keyboard.press("b");
seen.clip.off = await pictures(scene);

const height = () => scene.locator("#canvas").evaluate((drawn) => drawn.clientHeight);
seen.full = { before: await height() };
await scene.locator("#full").click();
await scene.waitForFunction(() => document.fullscreenElement?.id === "stage");
await settled(scene);
seen.full.within = { height: await height(), overflow: await scene.locator("#stage").evaluate((stage) => stage.scrollHeight - stage.clientHeight) };
await scene.locator("#full").click();
await scene.waitForFunction(() => !document.fullscreenElement);
await settled(scene);
seen.full.after = await height();
seen.scene.accessible = await accessible(scene);
console.log(JSON.stringify(seen));
await browser.close();

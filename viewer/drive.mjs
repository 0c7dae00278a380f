// Uses a page as a person would, and prints what was seen as JSON: node drive.mjs PAGE BROWSER
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [page, executablePath] = process.argv.slice(2);
const quiet = ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run"];
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", ...quiet];
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const browser = await chromium.launch({ executablePath, args });
const seen = { messages: [], requests: [] };

async function opened(width, height, colorScheme) {
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

/** Return for each view the share of pixels that differ from the background, and a digest of all pixels. */
async function pictures(tab) {
  await settled(tab);
  const png = (await tab.locator("#canvas").screenshot({ style: "#labels, #picked, #divider { visibility: hidden }" })).toString("base64");
  const views = await tab.locator(".label").evaluateAll((labels) => labels.map((l) => [l.offsetLeft, l.offsetTop, l.offsetWidth, l.offsetHeight]));
  return tab.evaluate(async ([data, places]) => {
    const bitmap = await createImageBitmap(new Blob([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))]));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    return places.map(([left, top, width, height]) => {
      const pixels = context.getImageData(left, top, width, height).data;
      const first = 4 * ((height - 20) * width + 20);
      let [drawn, digest] = [0, 7];
      for (let i = 0; i < pixels.length; i += 4) {
        let apart = 0;
        for (let c = 0; c < 3; c++) {
          apart += Math.abs(pixels[i + c] - pixels[first + c]);
          digest = (Math.imul(digest, 31) + pixels[i + c]) | 0;
        }
        if (apart > 30) drawn++;
      }
      return { share: drawn / (pixels.length / 4), digest };
    });
  }, [png, views]);
}

async function accessible(tab) {
  await tab.evaluate(axe);
  const found = await tab.evaluate(() => window.axe.run());
  return found.violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.map(({ html }) => html).join(" ")}`);
}

const labels = (tab) => tab.locator(".label").allInnerTexts();
const tab = await opened(1280, 900, "light");
seen.title = await tab.title();
seen.heading = await tab.locator("h1").innerText();
seen.start = await pictures(tab);
seen.labels = await labels(tab);
seen.colourings = {};
for (const option of await tab.locator("#colouring option").all()) {
  await tab.selectOption("#colouring", await option.getAttribute("value"));
  seen.colourings[await option.innerText()] = { pictures: await pictures(tab), legend: await tab.locator("#legend").innerText() };
}
await tab.selectOption("#colouring", { index: 0 });
await tab.locator("#count").fill("700");
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
seen.up = { pictures: await pictures(tab), text: await tab.locator("#up").innerText() };
for (let i = 0; i < 5; i++) await tab.keyboard.press("u");
seen.picked = [];
for (const { left, top, width, height } of await tab.locator(".label").evaluateAll((all) => all.map((l) => (
  { left: l.offsetLeft, top: l.offsetTop, width: l.offsetWidth, height: l.offsetHeight })))) {
  await tab.keyboard.press("Escape");
  await tab.mouse.click(box.x + left + width / 2, box.y + top + height / 2);
  const rows = await tab.locator("#picked dl").evaluate((list) => [...list.querySelectorAll("dt")].map((dt) => [dt.textContent, dt.nextSibling.textContent]));
  await settled(tab);
  seen.picked.push({ name: await tab.locator("#picked b").innerText(), values: Object.fromEntries(rows), rings: await tab.locator(".ring").count() });
}
await tab.keyboard.press("Escape");
seen.hidden = await tab.locator("#picked").isHidden();
await tab.keyboard.press("s");
seen.swipe = { labels: await labels(tab), middle: await pictures(tab) };
await tab.locator("#divider").fill("200");
seen.swipe.left = await pictures(tab);
await tab.keyboard.press("Tab");
await tab.locator("#side").click();
await tab.locator("#meshes").click();
seen.meshes = { pictures: await pictures(tab), labels: await labels(tab) };
await tab.locator("#points").click();
seen.points = await pictures(tab);
await tab.locator("#canvas").focus();
await tab.keyboard.press("m");
seen.meshes.pressed = await tab.locator("#meshes").getAttribute("aria-pressed");
seen.figures = await tab.locator("#table").innerText();
seen.plotted = await tab.locator("#plot circle").count();
seen.made = await tab.locator("#made").innerText();
seen.accessible = await accessible(tab);
const narrow = await opened(400, 850, "dark");
seen.narrow = {
  width: await narrow.evaluate(() => document.documentElement.scrollWidth),
  pictures: await pictures(narrow),
  accessible: await accessible(narrow),
};
seen.backgrounds = await Promise.all([tab, narrow].map((each) => each.evaluate(() => getComputedStyle(document.body).backgroundColor)));
console.log(JSON.stringify(seen));
await browser.close();

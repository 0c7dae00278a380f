// Opens a page several times and prints how fast it is as JSON: node measure.mjs PAGE-OR-URL BROWSER TIMES
// Times are in seconds since the navigation began. The processor draws (SwiftShader).
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [page, executablePath, times] = process.argv.slice(2);
const TURNING = 5; // seconds of dragging
const STEP = 12; // milliseconds between two moves of the pointer
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];

/** Note when the page has drawn for the first time, and how many pictures it draws. */
function watch() {
  const seen = (window.seen = { first: null, pictures: 0 });
  let drawn = false;
  for (const name of ["drawArrays", "drawElements"]) {
    const draw = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...given) {
      drawn = true;
      draw.apply(this, given);
    };
  }
  const request = window.requestAnimationFrame;
  window.requestAnimationFrame = (callback) => request((now) => {
    drawn = false;
    callback(now);
    if (!drawn) return;
    seen.pictures++;
    // The canvas can be read only now; to read it waits until it is drawn.
    if (seen.first === null && hasPicture(document.querySelector("canvas"))) seen.first = performance.now() / 1000;
  });
  function hasPicture(canvas) {
    const [width, height] = [200, 100];
    const context = new OffscreenCanvas(width, height).getContext("2d");
    context.drawImage(canvas, 0, 0, width, height);
    const { data } = context.getImageData(0, 0, width, height);
    let differ = 0;
    for (let i = 0; i < data.length; i += 4) if (Math.abs(data[i] - data[0]) + Math.abs(data[i + 1] - data[1]) > 60) differ++;
    return differ > width * height / 50;
  }
}

async function measure() {
  const browser = await chromium.launch({ executablePath, args });
  const tab = await browser.newPage({ viewport: { width: 1280, height: 900 } });
  await tab.addInitScript(watch);
  await tab.goto(page.startsWith("http:") ? page : pathToFileURL(page).href);
  await tab.waitForFunction(() => document.documentElement.dataset.state, null, { timeout: 120_000 });
  await tab.waitForFunction(() => window.seen.first !== null, null, { timeout: 120_000 });
  const told = () => tab.evaluate(() => document.getElementById("levels")?.textContent ?? "");
  while ((await told()).includes("on their way")) await tab.waitForTimeout(50);
  const loaded = await tab.evaluate(() => performance.now() / 1000);
  await tab.waitForTimeout(2000); // until all is drawn
  const drawn = Number((await told()).split(" ")[0].replaceAll(",", "")); // 0 on a page without levels
  const box = await tab.locator("#canvas").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 3];
  await tab.mouse.move(x, y);
  await tab.mouse.down();
  const before = await tab.evaluate(() => window.seen.pictures);
  const start = performance.now();
  for (let i = 1; performance.now() - start < 1000 * TURNING; i++) {
    await tab.mouse.move(x + 200 * Math.sin(i / 40), y + 40 * Math.sin(i / 60));
    await new Promise((done) => setTimeout(done, STEP));
  }
  const after = await tab.evaluate(() => window.seen.pictures);
  const passed = (performance.now() - start) / 1000;
  await tab.mouse.up();
  const { first } = await tab.evaluate(() => window.seen);
  await browser.close();
  return { first, loaded, drawn, rate: (after - before) / passed };
}

const measured = [];
for (let i = 0; i < Number(times); i++) measured.push(await measure());
console.log(JSON.stringify(measured));

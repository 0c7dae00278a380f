// Looks at a cloud by level as a person would, and prints what was seen as JSON: node drive_levels.mjs URL BROWSER
import { chromium } from "playwright-core";

const [url, executablePath] = process.argv.slice(2);
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"];
const browser = await chromium.launch({ executablePath, args });
const tab = await browser.newPage({ viewport: { width: 700, height: 800 } });
const seen = { messages: [], arrived: [], cancelled: 0 };
const number = (address) => Number(address.slice(url.length));
tab.on("console", (message) => { if (message.type() === "error") seen.messages.push(message.text()); });
tab.on("pageerror", (error) => seen.messages.push(error.message));
tab.on("requestfinished", (request) => { if (request.url() !== url) seen.arrived.push(number(request.url())); });
tab.on("requestfailed", () => seen.cancelled++);

/** Wait until all that is wanted is drawn; return what the page says, what has come since, and a digest of the views. */
async function settled() {
  await tab.waitForTimeout(600);
  await tab.waitForFunction(() => !document.getElementById("levels").textContent.includes("on their way"));
  await tab.waitForTimeout(600);
  const arrived = seen.arrived.splice(0);
  const picture = await tab.locator("#canvas").screenshot();
  return { told: await tab.locator("#levels").innerText(), arrived, picture: picture.toString("base64") };
}

const press = async (key, times = 1) => { for (let i = 0; i < times; i++) await tab.keyboard.press(key); };

await tab.goto(url);
await tab.waitForFunction(() => document.documentElement.dataset.state);
await tab.locator("#canvas").focus();
seen.start = await settled();
await press("+", 18);
seen.near = await settled();
await tab.selectOption("#colouring", { label: "intensity" });
seen.coloured = await settled();
const box = await tab.locator("#canvas").boundingBox();
await tab.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
seen.picked = await tab.locator("#picked dl").evaluate((list) =>
  Object.fromEntries([...list.querySelectorAll("dt")].map((dt) => [dt.textContent, dt.nextSibling.textContent])));
await tab.locator("#canvas").focus();
await press("Escape");
await press("0");
seen.back = await settled();
await tab.route(/\/\d+$/, async (route) => {
  await new Promise((done) => setTimeout(done, 1500));
  await route.continue().catch(() => {}); // it is not wanted any more
});
seen.cancelled = 0;
await press("+", 18);
await tab.keyboard.down("Shift");
await press("ArrowRight", 12); // to nodes that are not here
await tab.waitForTimeout(700);
await tab.keyboard.up("Shift");
await press("0");
seen.away = await settled();
console.log(JSON.stringify(seen));
await browser.close();

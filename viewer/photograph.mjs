// Takes a picture of a page as it opens, in a window of 1280 x 720: node photograph.mjs BROWSER PAGE PICTURE
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [executablePath, page, path] = process.argv.slice(2);
const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browser = await chromium.launch({ executablePath, args });
const tab = await browser.newPage({ viewport: { width: 1280, height: 720 } });
await tab.goto(pathToFileURL(page).href);
await tab.waitForFunction(() => document.documentElement.dataset.state === "ready", null, { timeout: 120_000 });
await tab.waitForTimeout(1000); // until all points are drawn
await tab.screenshot({ path });
await browser.close();

// Builds the page into one file: node build.mjs [FILE]. Python puts the data in place of DATA.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));
const bundled = async (entry, loader) => {
  const options = { bundle: true, minify: true, write: false, legalComments: "none", charset: "ascii" };
  const result = await build({ ...options, entryPoints: [here(entry)], format: "iife", target: "es2022", loader });
  return result.outputFiles[0].text.trim();
};

const script = await bundled("src/main.ts", { ".glsl": "text" });
const style = await bundled("src/style.css", {});
const digest = createHash("sha256").update(script).digest("base64");
const licence = readFileSync(here("node_modules/three/LICENSE"), "utf8").trim();
const page = readFileSync(here("src/page.html"), "utf8")
  .replace("{{licence}}", () => licence)
  .replace("{{digest}}", () => digest)
  .replace("{{style}}", () => style)
  .replace("{{script}}", () => script);
writeFileSync(process.argv[2] ?? here("../src/gppcs/drawing/web/page.html"), page);

import { createHash } from "node:crypto";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { join, relative } from "node:path";
import preact from "@preact/preset-vite";
import { defineConfig, type Plugin } from "vite";

const here = import.meta.dirname;
const API = join(here, "../../tests/service/openapi.json");
const NOT_SOURCES = new Set(["node_modules", "dist", "schema.d.ts", "tests"]);

function sources(folder: string): string[] {
  return readdirSync(folder, { withFileTypes: true })
    .filter((entry) => !NOT_SOURCES.has(entry.name))
    .flatMap((entry) => {
      const path = join(folder, entry.name);
      return entry.isDirectory() ? sources(path) : [path];
    });
}

/** Record what was built from what: SHA-256 over names and contents, which a test works out again. */
function recordSources(): Plugin {
  return {
    name: "record-sources",
    closeBundle() {
      const hash = createHash("sha256");
      const named = sources(here).map((path) => [relative(here, path), path] as const);
      for (const [name, path] of [...named.sort(([a], [b]) => (a < b ? -1 : 1)), ["openapi.json", API] as const]) {
        hash
          .update(`${name}\0`)
          .update(createHash("sha256").update(readFileSync(path)).digest("hex"))
          .update("\n");
      }
      writeFileSync(join(here, "dist/sources.sha256"), `${hash.digest("hex")}\n`);
    },
  };
}

export default defineConfig({
  plugins: [preact(), recordSources()],
  build: {
    outDir: "dist",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1600,
    rolldownOptions: { input: [join(here, "index.html"), join(here, "docs.html")] },
  },
});

/** How the page is built: from web/ into server/page/, which the server hands out under a strict content-security policy. */
import { defineConfig } from "vitest/config";

/** The server that `npm run dev` passes the API and the WebSocket on to. */
const SERVER = "http://127.0.0.1:8080";

export default defineConfig({
  base: "./", // a proxy may have put the page below a path of its own
  build: {
    outDir: "../server/page",
    emptyOutDir: true,
    target: "es2022",
    // Nothing is inlined as data: or blob: — the policy is default-src 'self', and a worker must be a file of its own.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    sourcemap: false,
    // docs.html is the frame of the reference pages, which the server fills (server/api/reference.py).
    rolldownOptions: {
      input: ["index.html", "docs.html"],
      // Modules of the first load in one file: many small ones are a third larger together.
      output: {
        advancedChunks: {
          groups: [
            {
              name: "shared",
              test: /\/src\/(wire|ui|texts|data|requests|page|extension)\/|node_modules/,
              minShareCount: 6,
            },
          ],
        },
      },
    },
  },
  worker: { format: "es" },
  server: {
    fs: { allow: [".", "../docs/guide"] },
    proxy: { "/api": SERVER, "/ws": { target: SERVER, ws: true }, "/healthz": SERVER },
  },
  test: {
    include: ["src/**/*.test.{ts,tsx}"],
    environment: "node",
    setupFiles: ["src/testing/each-file.ts"],
    testTimeout: 60_000,
    // Files share a worker and its modules: importing them for each file took most of the time. What a test leaves behind is removed
    // by src/testing/each-file.ts.
    isolate: false,
    maxWorkers: 1, // a second one would import everything again, and there is other work for the processor
    // A DOM is made of many short-lived objects; the default of 16 MB has them copied again and again. What has lived longer is kept until
    // there is less room: without a limit, for a gigabyte.
    execArgv: ["--max-semi-space-size=32", "--max-old-space-size=600"],
  },
});

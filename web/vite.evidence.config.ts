/** How the viewer of evidence files is built: one script and one style sheet that server/evidence/ puts into each file. */
import { defineConfig } from "vite";

export default defineConfig({
  publicDir: false,
  build: {
    outDir: "../server/page/evidence",
    emptyOutDir: true,
    target: "es2022",
    lib: {
      entry: "src/evidence/main.ts",
      formats: ["iife"],
      name: "evidence",
      fileName: () => "viewer.js",
      cssFileName: "viewer",
    },
  },
});

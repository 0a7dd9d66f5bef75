/** How the viewer of evidence files is built: one script and one style sheet that the server puts into each file. */

export default {
  publicDir: false,
  build: {
    outDir: "../server/page/evidence",
    emptyOutDir: true,
    target: "es2022",
    lib: {
      entry: "src/extensions/evidence/viewer/main.ts",
      formats: ["iife"],
      name: "evidence",
      fileName: () => "viewer.js",
      cssFileName: "viewer",
    },
  },
};

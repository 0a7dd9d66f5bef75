/** Extensions of other packages: what they bring to the page is fetched after its first picture. */
import { registerExtension } from "../../extension/extension";

registerExtension({
  name: "packages",
  start: (app) => void import("./door").then(({ loadExtensionPackages }) => loadExtensionPackages(app)),
});

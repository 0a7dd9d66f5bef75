/** The satellites of each receiver, with their strength and use. */
import { h } from "preact";
import { registerExtension } from "../../extension/extension";
import { channelsOf } from "../../panels/panel-context";
import { latePanel } from "../../ui/dom/late-panel";
import { skyTables } from "./satellite-data";
import { TEXT } from "./texts";

registerExtension({
  name: "satellites",
  panels: [
    {
      id: "satellites",
      readsCursor: true,
      title: TEXT.satellites,
      note: ["C/N", h("sub", null, "0"), TEXT.inDBHz],
      where: "below",
      order: 10,
      class: "satellites",
      applies: (deps) => skyTables(channelsOf(deps)).length > 0,
      mount: (host, deps) =>
        latePanel(async () => (await import("./panel")).mountSatellites.bind(undefined, host, deps)),
    },
  ],
});

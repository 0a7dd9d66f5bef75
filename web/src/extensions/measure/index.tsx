/** The measuring table under the plots, while both cursors are set. */
import { useComputed } from "@preact/signals";
import { registerExtension, type Slots } from "../../extension/extension";
import { PanelHost } from "../../panels/panel-host";
import { latePanel } from "../../ui/dom/late-panel";
import { TEXT } from "./texts";

function MeasurePanel({ viewState, samples }: Slots["underPlots"]) {
  const { cursor, measure } = viewState;
  const isMeasuring = useComputed(() => cursor.value?.kind === "pinned" && measure.value !== undefined);
  if (!isMeasuring.value) return null;
  const load = async () => (await import("./panel")).mountMeasure;
  return (
    <PanelHost
      class="measure"
      label={TEXT.title}
      mount={(host) => latePanel(async () => (await load()).bind(undefined, host, { viewState, ...samples }))}
    />
  );
}

registerExtension({ name: "measure", views: [{ slot: "underPlots", order: 20, View: MeasurePanel }] });

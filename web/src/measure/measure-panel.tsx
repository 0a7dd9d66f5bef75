/** The measuring table under the plots, while both cursors are set. */
import { useComputed } from "@preact/signals";
import { PanelHost } from "../ui/panel-host";
import { type MeasureDeps, mountMeasure } from "./panel";
import { TEXT } from "../texts/measure";

export function MeasurePanel({ deps }: { readonly deps: MeasureDeps }) {
  const { cursor, measure } = deps.viewState;
  const isMeasuring = useComputed(() => cursor.value?.kind === "pinned" && measure.value !== undefined);
  if (!isMeasuring.value) return null;
  return <PanelHost class="measure" label={TEXT.title} mount={(host) => mountMeasure(host, deps)} />;
}

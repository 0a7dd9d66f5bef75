/** An analysis as a panel: beside the plots, as long as it is wanted. Its code is fetched when it is first shown. */
import type { AnalysisPanel } from "../../data/view";
import { selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import type { PanelDefinition } from "../../panels/registry";
import { late } from "../../ui/dom/late";
import { renderedPanel } from "../../panels/panel-host";
import { TEXT } from "./texts";

const AnalysisView = late(async () => (await import("./dialog")).AnalysisView);

interface Props {
  readonly deps: Deps;
  readonly only?: AnalysisPanel;
}

/** Of the selected device; another device begins anew. */
function SelectedAnalysis({ deps, ...rest }: Props) {
  const { store, recording } = deps;
  const device = selected(deps)?.id;
  if (device === undefined) return null;
  const prefix = recording && store.devices.value.length > 1 ? `${device}/` : "";
  return (
    <AnalysisView
      key={device}
      deps={deps}
      source={recording?.id ?? device}
      prefix={prefix}
      isLive={!recording}
      {...rest}
    />
  );
}

/** A panel of one analysis, or of all, one at a time. Hidden until a person shows it. */
export const analysisPanel = (id: string, only: AnalysisPanel | undefined, order: number): PanelDefinition => ({
  id,
  title: TEXT[only ?? "analysis"],
  where: "main",
  height: "higher",
  order,
  class: "analysis-panel",
  optional: true,
  isWide: true,
  mount: (host, deps) => renderedPanel(host, <SelectedAnalysis deps={deps} {...(only ? { only } : {})} />),
});

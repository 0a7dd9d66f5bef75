/** An analysis as a panel: beside the plots, as long as it is wanted. Its code is fetched when it is first shown. */
import type { AnalysisPanel } from "../../data/view-state";
import { type Deps, selected } from "../../panels/panel-context";
import type { PanelDefinition } from "../../panels/registry";
import type { Panel } from "../../ui/dom";
import { late } from "../../ui/late";
import { renderedPanel } from "../../ui/panel-host";
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

/** @param only the analysis that is shown; default: all, one at a time */
export function mountAnalysis(host: HTMLElement, deps: Deps, only?: AnalysisPanel): Panel {
  return renderedPanel(host, <SelectedAnalysis deps={deps} {...(only ? { only } : {})} />);
}

/** The panel of one analysis. Hidden until a person shows it. */
export const analysisPanel = (id: string, only: AnalysisPanel, order: number): PanelDefinition => ({
  id,
  title: TEXT[only],
  where: "main",
  height: "higher",
  order,
  class: "analysis-panel",
  optional: true,
  isWide: true,
  mount: (host, deps) => mountAnalysis(host, deps, only),
});

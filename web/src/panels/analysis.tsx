/** The analysis as a panel: a spectrum beside the plots, as long as it is wanted. Hidden until a person shows it. */
import { render } from "preact";
import { TEXT } from "../texts/analysis";
import type { Panel } from "../ui/dom";
import { late } from "../ui/late";
import { type Deps, selected } from "./panel-context";
import { registerPanel } from "./registry";

const AnalysisView = late(async () => (await import("../analysis/dialog")).AnalysisView);

/** Of the selected device; another device begins anew. */
function SelectedAnalysis({ deps }: { readonly deps: Deps }) {
  const { store, recording } = deps;
  const device = selected(deps)?.id;
  if (device === undefined) return null;
  const prefix = recording && store.devices.value.length > 1 ? `${device}/` : "";
  return <AnalysisView key={device} deps={deps} source={recording?.id ?? device} prefix={prefix} isLive={!recording} />;
}

function mountAnalysis(host: HTMLElement, deps: Deps): Panel {
  render(<SelectedAnalysis deps={deps} />, host);
  return { update: () => undefined, dispose: () => render(null, host) };
}

registerPanel({
  id: "analysis",
  title: TEXT.analysis,
  where: "main",
  order: 20,
  class: "analysis-panel",
  optional: true,
  isWide: true,
  mount: mountAnalysis,
});

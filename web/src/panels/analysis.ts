/**
 * The panel of all analyses, one at a time: workspaces and links of earlier versions have it. It is offered where it is shown only; the
 * panels of one analysis each (analysis-panel.tsx) take its place.
 */
import { TEXT } from "../texts/analysis";
import { mountAnalysis } from "../analysis/panel";
import { registerPanel } from "./registry";

registerPanel({
  id: "analysis",
  title: TEXT.analysis,
  where: "main",
  height: "higher",
  order: 20,
  class: "analysis-panel",
  optional: true,
  isWide: true,
  applies: ({ viewState }) => viewState.layout.value.panels["analysis"]?.shown === true,
  mount: (host, deps) => mountAnalysis(host, deps),
});

/** The 3D scene, by viser, as a panel. Hidden until a person shows it; why it cannot be shown is said in its place. */
import { COMMON } from "../../texts/common";
import type { Panel } from "../../ui/dom/dom";
import { late } from "../../ui/dom/late";
import { reading, selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { renderedPanel } from "../../panels/panel-host";

const LiveScene = late(async () => (await import("./scene-frame")).Begun);
const RecordedScene = late(async () => (await import("./scene-frame")).Following);

function Scene({ deps }: { readonly deps: Deps }) {
  const { recording } = deps;
  const device = selected(deps)?.id;
  if (recording) {
    const player = { recording: recording.id, head: () => reading(deps).time, rate: recording.rate };
    return <RecordedScene player={player} />;
  }
  return device === undefined ? <p class="wait">{COMMON.none}</p> : <LiveScene key={device} device={device} />;
}

export function mountScene(host: HTMLElement, deps: Deps): Panel {
  return renderedPanel(host, <Scene deps={deps} />);
}

/** The 3D scene, by viser: in the frame of viewers, and as a panel. */
import { registerExtension } from "../../extension/extension";
import type { ReplayController } from "../../recordings/replay-controller";
import { Begun, Following } from "./scene-frame";
import { serverRoot, shownRobot } from "../../requests/server-place";
import { TEXT } from "./texts";
import { COMMON } from "../../texts/common";
import { late } from "../../ui/dom/late";
import { reading, selected } from "../../panels/panel-context";
import type { Deps } from "../../page/context";
import { renderedPanel } from "../../panels/panel-host";
import "./viser.css";

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

const Live = ({ device }: { readonly device: string | undefined }) => <Begun device={device ?? ""} />;

function Recording({ replay }: { readonly replay: ReplayController }) {
  const player = {
    recording: replay.detail.info.id,
    head: () => replay.head,
    rate: () => (replay.playing.peek() ? replay.speed.peek() : 0),
  };
  return <Following player={player} />;
}

registerExtension({
  name: "viser",
  viewers: [
    {
      id: "viser",
      order: 10,
      icon: "cube",
      title: TEXT.scene3d,
      choice: TEXT.scene,
      choiceHint: TEXT.sceneHint,
      object: TEXT.aScene,
      close: TEXT.closeScene,
      allHint: TEXT.allDevicesSideBySide,
      recordingTitle: TEXT.sceneOfRecording,
      address: (device) => `${serverRoot()}/viser/${device === undefined ? "" : `${device}/`}`,
      Live,
      Recording,
    },
  ],
  panels: [
    {
      id: "scene",
      title: TEXT.scene3d,
      where: "main",
      height: "high",
      order: 28,
      class: "scene-frame",
      optional: true,
      applies: () => shownRobot() === undefined, // a fleet server does not pass viewers on
      mount: (host, deps) => renderedPanel(host, <Scene deps={deps} />),
    },
  ],
});

/** The track, enlarged over a map: in a dialog, or as a panel that is hidden until a person shows it. */
import { positionOf } from "./position";
import { registerExtension } from "../../extension/extension";
import type { LiveDialogProps, Deps } from "../../page/context";
import type { RecordingDialogProps } from "../../pages/recordings/open-recording";
import { channelsOf } from "../../panels/panel-context";
import { COMMON } from "../../texts/common";
import { Dialog } from "../../ui/controls/dialog";
import type { Panel } from "../../ui/dom/dom";
import { latePanel } from "../../ui/dom/late-panel";
import { PanelHost } from "../../panels/panel-host";
import { fullName } from "../../wire/device-name";
import { TEXT } from "./texts";

const mount = (host: HTMLElement, deps: Deps): Panel =>
  latePanel(async () => (await import("./map")).mountLargeTrack.bind(undefined, host, deps));

interface Props {
  readonly deps: Deps;
  /** Name of the device. */
  readonly name: string;
  readonly onClose: () => void;
}

function TrackDialog({ deps, name, onClose }: Props) {
  return (
    <Dialog title={TEXT.trackOf(name)} wide onClose={onClose}>
      <PanelHost class="large-track" mount={(host) => mount(host, deps)} />
    </Dialog>
  );
}

const Live = ({ app, device, onClose }: LiveDialogProps) => (
  <TrackDialog deps={app} name={fullName(device)} onClose={onClose} />
);

const Recording = ({ recording: { replay, deps }, onClose }: RecordingDialogProps) => (
  <TrackDialog
    deps={{ ...deps, store: replay.drawn }}
    name={replay.device.value?.name ?? COMMON.theDevice}
    onClose={onClose}
  />
);

registerExtension({
  name: "map",
  panels: [
    {
      id: "track",
      readsCursor: true,
      title: TEXT.track,
      where: "main",
      height: "high",
      order: 26,
      class: "large-track",
      optional: true,
      applies: (deps) => positionOf(channelsOf(deps)) !== undefined,
      mount: (host, deps) => mount(host, { ...deps, store: deps.samples?.drawn ?? deps.store }),
    },
  ],
  dialogs: [{ overlay: "map/dialog", Live, Recording }],
  attitudeCells: [
    {
      applies: (channels) => positionOf(channels) !== undefined,
      mount: (host, deps) => latePanel(async () => (await import("./gnss")).mountGnss.bind(undefined, host, deps)),
    },
  ],
});

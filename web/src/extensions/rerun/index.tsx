/** The Rerun viewer: of live data in the frame of viewers, of recordings over the player. */
import { registerExtension } from "../../extension/extension";
import { theme } from "../../ui/dom/theme";
import { Frame } from "../../views/frame";
import { RerunButton, RerunPanel } from "./panel";
import { liveHref } from "./viewer-href";
import { TEXT } from "./texts";

const address = (device: string | undefined): string => liveHref(device, theme.value);

function Live({ device }: { readonly device: string | undefined }) {
  return <Frame key={address(device)} address={address(device)} title={TEXT.rerunViewer} />;
}

registerExtension({
  name: "rerun",
  viewers: [
    {
      id: "rerun",
      order: 20,
      icon: "wave",
      title: TEXT.rerun,
      choice: TEXT.rerun,
      choiceHint: TEXT.rerunHint,
      object: TEXT.rerun,
      close: TEXT.closeRerun,
      allHint: TEXT.allDevices,
      address,
      Live,
    },
  ],
  views: [
    { slot: "recordingActions", order: 20, View: RerunButton },
    { slot: "recordingViews", order: 10, View: RerunButton },
    { slot: "recordingOverlays", order: 10, View: RerunPanel },
  ],
});

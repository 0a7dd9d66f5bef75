/** Overlays of Live and of the pages of recordings: the list of keys, a packet, and the export dialog. */
import { Help } from "./help";
import type { App } from "../page/context";
import { LateExportDialog, LateGuide, LatePacket } from "./dialogs";
import { exportingOf } from "../recordings/exporting";

export function PageOverlays({ app }: { readonly app: App }) {
  const { overlay } = app;
  const exporting = exportingOf(app);
  const close = (): void => void (overlay.value = undefined);
  if (overlay.value === "help") return <Help onClose={close} onGuide={() => (overlay.value = "guide")} />;
  if (overlay.value === "guide") return <LateGuide onClose={close} />;
  if (overlay.value === "packet") return <LatePacket app={app} onClose={() => (overlay.value = undefined)} />;
  if (exporting.value) return <LateExportDialog app={app} of={exporting.value} />;
  return null;
}

/** Overlays of the pages of recordings: the list of keys, and the export dialog. */
import { Help } from "../../ui/help";
import { type App, overlay } from "../app-state";
import { ExportDialog, exporting } from "./export-dialog";

export function PageOverlays({ app }: { readonly app: App }) {
  if (overlay.value === "help") return <Help onClose={() => (overlay.value = undefined)} />;
  if (exporting.value) return <ExportDialog app={app} of={exporting.value} />;
  return null;
}

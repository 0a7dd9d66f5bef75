/** The dialogs of Live and of an open recording, each fetched when it is first opened. */
import { late } from "../ui/dom/late";

export const LateAddDevice = late(async () => (await import("../forms/add-device")).AddDevice, null, true);
export const LateExportDialog = late(async () => (await import("./recordings/export-dialog")).ExportDialog);
export const LateGuide = late(async () => (await import("../guide/guide")).Guide, null, true);
export const LateMemoryDialog = late(async () => (await import("./memory-dialog")).MemoryDialog);
export const LatePacket = late(async () => (await import("./packet-dialog")).OpenPacket);
export const LatePalette = late(async () => (await import("./palette")).CommandPalette, null, true);
export const LateSignalsPanel = late(async () => (await import("../panels/signals/panel")).SignalsPanel, null, true);
export const LateYAxisDialog = late(async () => (await import("../plots/y-axis-dialog")).YAxisDialog, null, true);

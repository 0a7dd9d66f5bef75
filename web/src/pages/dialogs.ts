/** The dialogs of Live and of an open recording, each fetched when it is first opened. */
import { late } from "../ui/late";

export const AddDevice = late(async () => (await import("../forms/add-device")).AddDevice);
export const ExportDialog = late(async () => (await import("./recordings/export-dialog")).ExportDialog);
export const MemoryDialog = late(async () => (await import("./memory-dialog")).MemoryDialog);
export const Packet = late(async () => (await import("./packet-dialog")).Packet);
export const SignalsPanel = late(async () => (await import("../signals/panel")).SignalsPanel);
export const YAxisDialog = late(async () => (await import("../plots/y-axis-dialog")).YAxisDialog);

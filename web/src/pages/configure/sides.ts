/** Sides of a comparison by the names that menus and addresses give them, as the server is asked for them; and which snapshots a list shows. */
import type { SideRef, SnapshotInfo } from "../../wire/form-types";
import { TEXT } from "../../texts/configure";

/** "device", "~factory", "~file", "~other:<id>", or a snapshot's name. */
export type SideName = string;

const BLANK = { snapshot: "", device: "", text: "" };

/** A side in the device's own terms. */
export function sideRef(side: SideName, file: string): SideRef {
  if (side === "device" || side === "~factory") return { ...BLANK, side: side === "device" ? "device" : "factory" };
  if (side === "~file") return { ...BLANK, side: "text", text: file };
  if (side.startsWith("~other:")) return { ...BLANK, side: "other", device: side.slice("~other:".length) };
  return { ...BLANK, side: "snapshot", snapshot: side };
}

/** A side of one device's page in the terms of another device; undefined if it would be compared with itself. */
export function refFor(side: SideName, file: string, owner: string, target: string): SideRef | undefined {
  if (side === "device") return target === owner ? undefined : { ...BLANK, side: "other", device: owner };
  if (side === `~other:${target}`) return undefined;
  const own = sideRef(side, file);
  return own.side === "snapshot" && target !== owner ? { ...own, device: owner } : own;
}

/** Titles shared by many snapshots; their reason distinguishes them. */
const GENERIC = new Set([TEXT.beforeThisChange, TEXT.readFromTheDevice]);

/** A distinguishing title of a snapshot: its own name, or the change written after it was taken. */
export function snapshotTitle({ title, reason }: Pick<SnapshotInfo, "title" | "reason">): string {
  if (!GENERIC.has(title) || reason === "") return title;
  return /^before /i.test(reason) ? reason.replace(/\.$/, "") : `${title}: ${reason}`;
}

/** Snapshots of a short list: the newest, the named ones, and the first contact; newest first. */
export function listed(all: readonly SnapshotInfo[], newest: number): readonly SnapshotInfo[] {
  let left = newest;
  return all.filter(({ pinned }) => pinned || left-- > 0);
}

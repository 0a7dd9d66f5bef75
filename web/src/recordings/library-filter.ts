/** Words and filters of the library: search, categories, lengths and sizes. Pure. */
import { number, type Quantity } from "../ui/format/format";
import type { RecordingDetail, RecordingInfo } from "../wire/recording-types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/recordings";

export type Category = "all" | "pinned" | "lossy" | "damaged" | "deleted";

export const CATEGORIES: readonly { readonly name: Category; readonly title: string }[] = [
  { name: "all", title: COMMON.all },
  { name: "pinned", title: TEXT.pinned },
  { name: "lossy", title: TEXT.withLoss },
  { name: "damaged", title: TEXT.damagedFilter },
  { name: "deleted", title: TEXT.deleted7Days },
];

/** The recording with only the devices that sent anything; with all of them if none did. */
export function withReceiving(info: RecordingInfo): RecordingInfo {
  const receiving = info.devices.filter(({ messages }) => messages !== 0);
  return receiving.length === 0 || receiving.length === info.devices.length ? info : { ...info, devices: receiving };
}

/** The same for an opened recording: devices with a quantity. */
export function heardIn(detail: RecordingDetail): RecordingDetail {
  const receiving = detail.devices.filter(({ id }) => detail.channels.some(({ device }) => device === id));
  return { ...detail, info: withReceiving(detail.info), devices: receiving.length === 0 ? detail.devices : receiving };
}

export const lostOf = (info: RecordingInfo): number => info.devices.reduce((sum, { lost }) => sum + lost, 0);
export const rejectsOf = (info: RecordingInfo): number => info.devices.reduce((sum, { rejects }) => sum + rejects, 0);
/** Frames of all devices; undefined until they have been counted, which opening the recording does. */
export const messagesOf = (info: RecordingInfo): number | undefined =>
  info.devices.reduce<number | undefined>(
    (sum, { messages }) => (sum === undefined || messages === null ? undefined : sum + messages),
    0,
  );

/** Whether it was opened; losses of an unopened one are unknown. */
export const isKnown = ({ opened, thumbnail }: RecordingInfo): boolean => opened || thumbnail.length > 0;

/** Lost samples of all devices; undefined if none are known, and what a device sent does not tell. */
export function knownLosses(info: RecordingInfo): number | undefined {
  const lost = lostOf(info);
  const areCounted = isKnown(info) && info.devices.every((device) => device.counts_losses);
  return lost > 0 || areCounted ? lost : undefined;
}

/** The losses in words: "—" is not read yet; without a counter only what is known is said, as by the player. */
export function recordedLosses(info: RecordingInfo): string {
  const lost = knownLosses(info);
  if (lost === undefined) return isKnown(info) ? TEXT.noneKnown : "—";
  return lost === 0 ? COMMON.none : number(lost, 0);
}

export function inCategory(info: RecordingInfo, category: Category): boolean {
  if (category === "deleted") return info.deleted !== null;
  if (info.deleted !== null) return false;
  switch (category) {
    case "all":
      return true;
    case "pinned":
      return info.pinned;
    case "lossy":
      return lostOf(info) > 0 || info.losses.length > 0;
    case "damaged":
      return info.damaged !== "";
  }
}

/** Selected filters and the search text. */
export interface LibraryChoice {
  readonly category: Category;
  /** A name of `deviceName`, or "" for any. */
  readonly device: string;
  readonly tag: string;
  readonly query: string;
}

/** Name with serial number, unless the name contains it. */
export function deviceName({ name, product, serial_number: serial }: RecordingInfo["devices"][number]): string {
  const called = name || product;
  return ` ${called}`.endsWith(` ${serial}`) ? called : `${called} ${serial}`.trim();
}

/** The devices that are known. A table or a log without one is named after its file, which is said already. */
export function knownDevices({ id, devices }: Pick<RecordingInfo, "id" | "devices">): RecordingInfo["devices"] {
  return devices.filter(
    ({ name, product, serial_number: serial }) =>
      product !== "" || serial !== "" || (name !== id && name.replace(/\.[^.]*$/, "") !== id),
  );
}

/** Title of a recording; an untitled one is named by its devices, with its date beside it. */
export function recordingTitle(info: Pick<RecordingInfo, "title" | "id" | "devices">): string {
  if (info.title !== "" && info.title !== info.id) return info.title;
  return [...new Set(knownDevices(info).map(({ name, product }) => name || product))].join(" + ") || info.id;
}

/** Whether every typed word occurs in its metadata. */
export function recordingMatches(info: RecordingInfo, query: string): boolean {
  const words = query.toLowerCase().split(/\s+/).filter(Boolean);
  if (words.length === 0) return true;
  const devices = info.devices.flatMap((one) => [one.name, one.product, one.serial_number, one.protocol]);
  const text = [
    info.title,
    info.file,
    info.notes,
    dateWords(info.started),
    isoDay(info.started),
    ...info.tags,
    ...devices,
  ]
    .join("\n")
    .toLowerCase();
  return words.every((word) => text.includes(word));
}

export function chosen(
  all: readonly RecordingInfo[],
  { category, device, tag, query }: LibraryChoice,
): readonly RecordingInfo[] {
  return all.filter(
    (info) =>
      inCategory(info, category) &&
      (device === "" || knownDevices(info).some((one) => deviceName(one) === device)) &&
      (tag === "" || info.tags.includes(tag)) &&
      recordingMatches(info, query),
  );
}

/** How often each value occurs, most often first. */
export function countedValues(values: readonly string[]): readonly (readonly [string, number])[] {
  const counts = new Map<string, number>();
  for (const value of values) counts.set(value, (counts.get(value) ?? 0) + 1);
  return [...counts].sort(([a, m], [b, n]) => n - m || a.localeCompare(b));
}

/** The most serious problem, in one tag. */
export function flaw(info: RecordingInfo): { readonly tone: "" | "warn" | "bad"; readonly words: string } {
  if (info.damaged !== "") return { tone: "bad", words: TEXT.damagedTag };
  const [lost, rejects] = [knownLosses(info), rejectsOf(info)];
  if (lost) return { tone: "warn", words: TEXT.lostCount(number(lost, 0)) };
  if (rejects > 0) return { tone: "warn", words: TEXT.rejectCount(rejects) };
  return { tone: "", words: recordedLosses(info) };
}

const pad = (n: number): string => String(Math.floor(n)).padStart(2, "0");

/** A length or position in a recording: "47:12", "10:00:04"; with digits of a second "21:52.314". */
export function length(seconds: number | null | undefined, decimals = 0): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return "—";
  if (decimals === 0 && seconds > 0 && seconds < 1) return `${number(seconds, 2)} s`;
  const scale = 10 ** decimals;
  const ticks = Math.floor(Math.abs(seconds) * scale + 1e-6);
  const s = Math.floor(ticks / scale);
  const hours = Math.floor(s / 3600);
  const text = `${hours > 0 ? `${hours}:` : ""}${pad((s % 3600) / 60)}:${pad(s % 60)}`;
  return (seconds < 0 ? "−" : "") + text + (decimals > 0 ? `.${String(ticks % scale).padStart(decimals, "0")}` : "");
}

export function bytes(n: number | null | undefined): Quantity {
  if (n === null || n === undefined || !Number.isFinite(n)) return { value: "—", unit: "" };
  if (n < 1000) return { value: number(n, 0), unit: "B" };
  if (n < 1e6) return { value: number(n / 1e3, 1), unit: "kB" };
  if (n < 1e9) return { value: number(n / 1e6, 1), unit: "MB" };
  return { value: number(n / 1e9, 2), unit: "GB" };
}

/** "21 Nov, 13:44" in UTC, as all times of the page; with the year if asked, or if it is not the current one. */
export function dateWords(unix: number | null, year = false): string {
  if (unix === null) return "";
  const d = new Date(unix * 1000);
  return `${dayWords(unix, year)}, ${pad(d.getUTCHours())}:${pad(d.getUTCMinutes())}`;
}

/** The day of `dateWords`: "21 Nov", "8 Feb 2017". */
export function dayWords(unix: number, year = false): string {
  const d = new Date(unix * 1000);
  const isNamed = year || d.getUTCFullYear() !== new Date().getUTCFullYear();
  return `${d.getUTCDate()} ${COMMON.months[d.getUTCMonth()]}${isNamed ? ` ${d.getUTCFullYear()}` : ""}`;
}

function isoDay(unix: number | null): string {
  return unix === null ? "" : new Date(unix * 1000).toISOString().slice(0, 10);
}

/** Days until a recording in the bin is deleted. */
export function daysLeft(deleted: number, now: number): number {
  return Math.max(0, Math.ceil(7 - (now - deleted) / 86_400));
}

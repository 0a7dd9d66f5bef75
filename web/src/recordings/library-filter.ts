/** Words and filters of the library: search, categories, lengths and sizes. Pure. */
import { number, type Quantity } from "../ui/format/format";
import type { RecordingDetail, RecordingInfo } from "../wire/recording-types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/recordings";

export type Category = "all" | "pinned" | "lossy" | "damaged" | "unread" | "deleted";

export const CATEGORIES: readonly { readonly name: Category; readonly title: string }[] = [
  { name: "all", title: COMMON.all },
  { name: "pinned", title: TEXT.pinned },
  { name: "lossy", title: TEXT.withLoss },
  { name: "damaged", title: TEXT.damagedFilter },
  { name: "unread", title: TEXT.notReadFilter },
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

/** Whether its contents have been read; until then its losses and motion are unknown. */
export const isKnown = ({ opened, read }: Pick<RecordingInfo, "opened" | "read">): boolean => read || opened;

/** Lost samples of all devices; undefined if none are known, and what a device sent does not tell. */
export function knownLosses(info: RecordingInfo): number | undefined {
  const lost = lostOf(info);
  const areCounted = isKnown(info) && info.devices.every((device) => device.counts_losses);
  return lost > 0 || areCounted ? lost : undefined;
}

/** The losses in words; without a counter only what is known is said, as by the player. */
export function recordedLosses(info: RecordingInfo): string {
  const lost = knownLosses(info);
  if (lost === undefined) return isKnown(info) ? TEXT.noneKnown : TEXT.notReadYet;
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
      return isKnown(info) && (lostOf(info) > 0 || info.losses.length > 0);
    case "unread":
      return !isKnown(info) && !info.recording;
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

/** Names of the known devices, each once. */
export const namesOfDevices = (info: Pick<RecordingInfo, "id" | "devices">): string =>
  [...new Set(knownDevices(info).map(({ name, product }) => name || product))].join(" + ");

/** Of a file that imuscope has named itself: 20261121T044324Z-MTi-630. */
const STAMPED = /^\d{8}T\d{6}Z/;
/** Most characters of a note that names its recording. */
const NAME_CHARACTERS = 120;

/**
 * Name of a recording: its title, else the first line of its notes, else when what was driven; a file that was named elsewhere, and has
 * neither, keeps that name.
 */
export function recordingTitle(info: Pick<RecordingInfo, "title" | "id" | "devices" | "notes" | "started">): string {
  if (info.title !== "" && info.title !== info.id) return info.title;
  const [note = ""] = info.notes.trim().split("\n");
  if (note !== "") return note.slice(0, NAME_CHARACTERS);
  if (!STAMPED.test(info.id)) return info.id;
  return [dateWords(info.started), namesOfDevices(info)].filter(Boolean).join(" · ") || info.id;
}

const namesIn = new WeakMap<readonly RecordingInfo[], ReadonlyMap<RecordingInfo, string>>();

/** Names of a list, in which none occurs twice: equal ones are followed by when they began, else by their file. */
export function distinctNames(list: readonly RecordingInfo[]): ReadonlyMap<RecordingInfo, string> {
  const known = namesIn.get(list);
  if (known !== undefined) return known;
  const names = new Map(list.map((info) => [info, recordingTitle(info)] as const));
  const day = (info: RecordingInfo): string =>
    recordingTitle(info).startsWith(dateWords(info.started)) ? "" : dateWords(info.started);
  const further = [
    day,
    ({ started }: RecordingInfo) => isoSecond(started).slice(-8),
    ({ file }: RecordingInfo) => file,
  ];
  for (const more of further) {
    const counts = new Map(countedValues([...names.values()]));
    for (const [info, name] of names)
      if ((counts.get(name) ?? 0) > 1) names.set(info, [name, more(info)].filter(Boolean).join(" · "));
  }
  namesIn.set(list, names);
  return names;
}

const texts = new WeakMap<RecordingInfo, string>();

/** All that a recording is found by, in small letters; made once, as each key that is typed asks for it. */
function searchText(info: RecordingInfo): string {
  const known = texts.get(info);
  if (known !== undefined) return known;
  const devices = info.devices.flatMap((one) => [one.name, one.product, one.serial_number, one.protocol]);
  const text = [
    recordingTitle(info),
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
  texts.set(info, text);
  return text;
}

export const wordsOf = (query: string): readonly string[] => query.toLowerCase().split(/\s+/).filter(Boolean);

/** Whether every typed word occurs in its metadata. */
export const recordingMatches = (info: RecordingInfo, words: readonly string[]): boolean =>
  words.every((word) => searchText(info).includes(word));

export function chosen(
  all: readonly RecordingInfo[],
  { category, device, tag, query }: LibraryChoice,
): readonly RecordingInfo[] {
  const words = wordsOf(query);
  return all.filter(
    (info) =>
      inCategory(info, category) &&
      (device === "" || knownDevices(info).some((one) => deviceName(one) === device)) &&
      (tag === "" || info.tags.includes(tag)) &&
      recordingMatches(info, words),
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

const isoSecond = (unix: number | null): string =>
  unix === null ? "" : new Date(unix * 1000).toISOString().slice(0, 19).replace("T", " ");

const isoDay = (unix: number | null): string => isoSecond(unix).slice(0, 10);

/** Days until a recording in the bin is deleted. */
export function daysLeft(deleted: number, now: number): number {
  return Math.max(0, Math.ceil(7 - (now - deleted) / 86_400));
}

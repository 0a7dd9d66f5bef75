/** How the library is listed: its columns and their order, which the browser keeps. Pure, but for the storage. */
import type { RecordingInfo } from "../wire/recording-types";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/recordings";
import { namesOfDevices, isKnown, knownLosses, rejectsOf } from "./library-filter";

export type LibraryColumn =
  | "motion"
  | "name"
  | "devices"
  | "recorded"
  | "length"
  | "size"
  | "loss"
  | "tags"
  | "markers"
  | "file";

interface Column {
  readonly name: LibraryColumn;
  readonly title: string;
  /** px; absent: the rest. */
  readonly width?: number;
  /** Right-aligned. */
  readonly isNumber?: boolean;
  /** What the rows are sorted by, the first time ascending or descending; absent: they cannot be. */
  readonly key?: (info: RecordingInfo, nameOf: (info: RecordingInfo) => string) => string | number | null | undefined;
  readonly isDescending?: boolean;
}

export const LIBRARY_COLUMNS: readonly Column[] = [
  { name: "motion", title: TEXT.motion, width: 130 },
  { name: "name", title: TEXT.recording, key: (info, nameOf) => nameOf(info) },
  { name: "devices", title: COMMON.devices, width: 110, key: (info) => namesOfDevices(info) },
  {
    name: "recorded",
    title: TEXT.recorded,
    width: 110,
    isNumber: true,
    key: ({ started }) => started,
    isDescending: true,
  },
  {
    name: "length",
    title: TEXT.length,
    width: 72,
    isNumber: true,
    key: ({ duration }) => duration,
    isDescending: true,
  },
  { name: "size", title: TEXT.size, width: 76, isNumber: true, key: ({ size }) => size, isDescending: true },
  { name: "loss", title: COMMON.loss, width: 92, key: worst, isDescending: true },
  { name: "tags", title: TEXT.tags, width: 110, key: ({ tags }) => tags.join(" ") || null },
  {
    name: "markers",
    title: COMMON.markers,
    width: 76,
    isNumber: true,
    key: ({ markers }) => markers,
    isDescending: true,
  },
  { name: "file", title: TEXT.file, width: 240, key: ({ file }) => file },
];

/** Damaged ones are worse than any loss; of unread ones nothing is known. */
function worst(info: RecordingInfo): number | undefined {
  if (info.damaged !== "") return Infinity;
  return isKnown(info) ? (knownLosses(info) ?? 0) + rejectsOf(info) / 1e6 : undefined;
}

export interface LibraryView {
  readonly by: LibraryColumn;
  readonly isDescending: boolean;
  /** Chosen by the user; undefined: those that have room. */
  readonly columns?: readonly LibraryColumn[];
}

export const USUAL: LibraryView = { by: "recorded", isDescending: true };
/** Of the columns that nobody chose. */
export const USUAL_COLUMNS: readonly LibraryColumn[] = LIBRARY_COLUMNS.slice(0, 8).map(({ name }) => name);

/** The view after a press on a head: its column, then the other direction. */
export function sortedBy(view: LibraryView, by: LibraryColumn): LibraryView {
  const first = LIBRARY_COLUMNS.find(({ name }) => name === by)?.isDescending ?? false;
  return { ...view, by, isDescending: view.by === by ? !view.isDescending : first };
}

/** The view with a column shown or not; the name stays. */
export function withLibraryColumn(view: LibraryView, name: LibraryColumn, isShown: boolean): LibraryView {
  const now = view.columns ?? USUAL_COLUMNS;
  return {
    ...view,
    columns: LIBRARY_COLUMNS.map((one) => one.name).filter((one) => (one === name ? isShown : now.includes(one))),
  };
}

/** In the order of the view; those without a value are the last in both directions. */
export function sortRecordings(
  list: readonly RecordingInfo[],
  { by, isDescending }: LibraryView,
  nameOf: (info: RecordingInfo) => string,
): readonly RecordingInfo[] {
  const key = LIBRARY_COLUMNS.find(({ name }) => name === by)?.key;
  if (key === undefined) return list;
  const collator = new Intl.Collator(undefined, { numeric: true });
  const keyed = list.map((info) => ({ info, value: key(info, nameOf) }));
  const side = isDescending ? -1 : 1;
  keyed.sort(({ value: a }, { value: b }) => {
    if (a === null || a === undefined || a === "") return b === null || b === undefined || b === "" ? 0 : 1;
    if (b === null || b === undefined || b === "") return -1;
    return (
      side *
      (typeof a === "number" && typeof b === "number" ? (a > b ? 1 : a < b ? -1 : 0) : collator.compare(`${a}`, `${b}`))
    );
  });
  return keyed.map(({ info }) => info);
}

const KEY = "imuscope.library";

/** The stored view; a storage that is forbidden, or holds something else, has the usual one. */
export function storedView(): LibraryView {
  try {
    const { by, isDescending, columns } = JSON.parse(localStorage.getItem(KEY) ?? "{}") as Partial<LibraryView>;
    const isName = (one: unknown): one is LibraryColumn => LIBRARY_COLUMNS.some(({ name }) => name === one);
    return {
      ...(isName(by) && typeof isDescending === "boolean" ? { by, isDescending } : USUAL),
      ...(Array.isArray(columns) && columns.every(isName) ? { columns } : {}),
    };
  } catch {
    return USUAL;
  }
}

export function storeView(view: LibraryView): void {
  try {
    localStorage.setItem(KEY, JSON.stringify(view));
  } catch {
    // as above
  }
}

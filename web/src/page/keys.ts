/**
 * Keyboard shortcuts in one table: the page handles them by it, the `?` overlay prints it, the tooltips name keys from it.
 *
 * Letters are compared by the character typed (`event.key`), so the map follows the keyboard's layout; digits by the key's
 * place (`event.code`), because with Shift they type something else on every layout. A key with Ctrl, Alt or Meta belongs to
 * the browser and is left alone.
 */
import { fromExtensions } from "../extension/extension";
import type { App } from "./context";
import { COMMON } from "../texts/common";

export interface ExtensionPress {
  readonly app: App;
  readonly isShifted: boolean;
}

/** A key of Live and of open recordings. */
export interface ExtensionKey {
  /** A letter, in lower case. */
  readonly key: string;
  /** Its line in the list of keys: under this title, before the line of a key or at the end. */
  readonly group: string;
  readonly before?: string;
  readonly what: string;
  /** Whether the line has it with Shift too. */
  readonly withShift?: boolean;
  readonly press: (at: ExtensionPress) => void;
}

declare module "../extension/extension" {
  interface Extension {
    readonly keys?: readonly ExtensionKey[];
  }
}

export type KeyAction =
  | {
      readonly do:
        | "record"
        | "askRecord"
        | "link"
        | "mark"
        | "note"
        | "playPause"
        | "fit"
        | "start"
        | "now"
        | "timeBase"
        | "help"
        | "packet"
        | "signals"
        | "measure"
        | "close";
    }
  | { readonly do: "extension"; readonly press: (at: Omit<ExtensionPress, "isShifted">) => void }
  | { readonly do: "pan"; readonly windows: number }
  | { readonly do: "step"; readonly samples: number }
  | { readonly do: "stepMeasure"; readonly samples: number }
  | { readonly do: "span"; readonly longer: boolean }
  | { readonly do: "zoom"; readonly factor: number }
  | { readonly do: "series"; readonly index: number; readonly alone: boolean };

/** Properties of a KeyboardEvent used by `actionFor`. */
export interface KeyPress {
  readonly key: string;
  readonly code: string;
  readonly shiftKey: boolean;
  readonly ctrlKey: boolean;
  readonly altKey: boolean;
  readonly metaKey: boolean;
}

/** How much one press of `+` or `-` changes the window. */
export const ZOOM_STEP = 1.5;

/** One line of the overlay: the keys as printed, and their effect. */
export interface KeyLine {
  readonly keys: readonly string[];
  readonly what: string;
}

/** What the overlay prints, by subject. */
export interface KeyGroup {
  readonly title: string;
  readonly lines: readonly KeyLine[];
}

const GROUPS: readonly KeyGroup[] = [
  {
    title: COMMON.keysOfTime,
    lines: [
      { keys: ["Space"], what: COMMON.keyLiveOrPause },
      { keys: ["←", "→"], what: COMMON.keyPanTenth },
      { keys: ["Shift ←", "Shift →"], what: COMMON.keyPanWindow },
      { keys: [",", "."], what: COMMON.keyStep },
      { keys: ["[", "]"], what: COMMON.keySpan },
      { keys: ["+", "−"], what: COMMON.keyZoom },
      { keys: ["F"], what: COMMON.keyFit },
      { keys: ["Home", "End"], what: COMMON.keyStartNow },
      { keys: ["T"], what: COMMON.keyTimeBase },
      { keys: ["L"], what: COMMON.keyLoop },
    ],
  },
  {
    title: COMMON.keysOfMeasuring,
    lines: [
      { keys: ["B"], what: COMMON.keyMeasure },
      { keys: ["Shift ,", "Shift ."], what: COMMON.keyStepMeasure },
      { keys: ["P"], what: COMMON.keyPacket },
    ],
  },
  {
    title: COMMON.keysOfLayout,
    lines: [
      { keys: ["1 … 9"], what: COMMON.keySeries },
      { keys: ["Shift 1 … 9"], what: COMMON.keySeriesAlone },
      { keys: ["S"], what: COMMON.keySignals },
      { keys: ["W"], what: COMMON.keyArrange },
      { keys: ["X"], what: COMMON.keyMaximise },
      { keys: ["Ctrl+Z", "Ctrl+Shift+Z"], what: COMMON.keyUndo },
    ],
  },
  {
    title: COMMON.keysOfRecording,
    lines: [
      { keys: ["Shift R"], what: COMMON.keyRecord },
      { keys: ["M", "Shift M"], what: COMMON.keyMarker },
      { keys: ["C"], what: COMMON.keyLink },
    ],
  },
  {
    title: COMMON.keysOfPages,
    lines: [
      { keys: ["G L", "G C", "G R"], what: COMMON.keyPages },
      { keys: ["Ctrl+K"], what: COMMON.keyPalette },
      { keys: ["/"], what: COMMON.keySearch },
      { keys: ["?"], what: COMMON.keyboard },
      { keys: ["Esc"], what: COMMON.keyClose },
    ],
  },
];

/** What the list of keys prints: the keys of the page, and those of its extensions among them. */
export function keyGroups(): readonly KeyGroup[] {
  const groups = GROUPS.map(({ title, lines }) => ({ title, lines: [...lines] }));
  for (const { key, group, before, what, withShift } of fromExtensions("keys")) {
    const lines = groups.find(({ title }) => title === group)?.lines ?? [];
    const place = lines.findIndex(({ keys }) => before !== undefined && keys.includes(before));
    const letter = key.toUpperCase();
    const keys = withShift ? [letter, `Shift ${letter}`] : [letter];
    lines.splice(place < 0 ? lines.length : place, 0, { keys, what });
  }
  return groups;
}

const SIMPLE: Readonly<Record<string, KeyAction>> = {
  " ": { do: "playPause" },
  ",": { do: "step", samples: -1 },
  ".": { do: "step", samples: 1 },
  "[": { do: "span", longer: false },
  "]": { do: "span", longer: true },
  "+": { do: "zoom", factor: 1 / ZOOM_STEP },
  "=": { do: "zoom", factor: 1 / ZOOM_STEP },
  "-": { do: "zoom", factor: ZOOM_STEP },
  _: { do: "zoom", factor: ZOOM_STEP },
  f: { do: "fit" },
  home: { do: "start" },
  end: { do: "now" },
  t: { do: "timeBase" },
  c: { do: "link" },
  s: { do: "signals" },
  b: { do: "measure" },
  p: { do: "packet" },
  "?": { do: "help" },
  escape: { do: "close" },
};

/** The action of a key press, or undefined for other keys. */
export function actionFor(press: KeyPress): KeyAction | undefined {
  if (press.ctrlKey || press.altKey || press.metaKey) return undefined;
  const key = press.key.toLowerCase();
  if (key === "arrowleft" || key === "arrowright") {
    return { do: "pan", windows: (key === "arrowleft" ? -1 : 1) * (press.shiftKey ? 1 : 0.1) };
  }
  if (key === "r") return { do: press.shiftKey ? "record" : "askRecord" };
  if (key === "m") return { do: press.shiftKey ? "note" : "mark" };
  // with Shift they type something else on every layout
  const side = press.code === "Comma" ? -1 : press.code === "Period" ? 1 : 0;
  if (press.shiftKey && side !== 0) return { do: "stepMeasure", samples: side };
  const digit = /^(?:Digit|Numpad)([1-9])$/.exec(press.code);
  if (digit) return { do: "series", index: Number(digit[1]) - 1, alone: press.shiftKey };
  const added = fromExtensions("keys").find((one) => one.key === key);
  return (
    SIMPLE[key] ?? (added && { do: "extension", press: (at) => added.press({ ...at, isShifted: press.shiftKey }) })
  );
}

/** The window lengths of the menu, in seconds; `[` and `]` step through them. */
export const SPANS: readonly number[] = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600];

/** The next longer or shorter window of the menu; the ends stay. */
export function nextSpan(current: number, longer: boolean): number {
  const eps = current * 1e-6;
  const found = longer ? SPANS.find((s) => s > current + eps) : SPANS.findLast((s) => s < current - eps);
  return found ?? (longer ? Math.max(current, SPANS.at(-1) ?? current) : Math.min(current, SPANS[0] ?? current));
}

/** Whether typing belongs to a control and not to the page. Space and Enter also belong to a focused button or link. */
export function belongsToControl(tag: string, type: string, editable: boolean, press: KeyPress): boolean {
  if (editable || tag === "TEXTAREA" || tag === "SELECT") return true;
  if (tag === "INPUT" && !["checkbox", "radio", "button", "range"].includes(type)) return true;
  const pressing = press.key === " " || press.key === "Enter";
  return pressing && (tag === "BUTTON" || tag === "A" || tag === "SUMMARY" || tag === "INPUT");
}

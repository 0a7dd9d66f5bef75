/**
 * The two sides of a comparison and its address: A is the reference, B is compared with it.
 *
 *     #/recordings?a=yard-loop&ad=1&a0=…&a1=…&b=2&bl=30&signal=Acceleration&offset=1.25
 *     a, b: recording or live device · ad: device of the recording · a0, a1: range, unix s · al: last seconds of a live device
 */
import type { ViewState } from "../../../data/view-state";
import type { RecordingInfo } from "../../../wire/recording-types";
import type { ComparedSide } from "../../../wire/routes";
import type { DeviceInfo } from "../../../wire/types";
import type { Route } from "../../../page/route";

export interface SideChoice {
  /** Id of a recording or of a live device. */
  readonly source: string;
  /** Device of the recording; "" for a live one. */
  readonly device: string;
  /** Unix s; everything without them. */
  readonly begin?: number;
  readonly end?: number;
  /** Seconds up to now, of a live device. */
  readonly last?: number;
}

export interface ComparePlace {
  readonly a: SideChoice;
  /** Chosen by the page if the address has none. */
  readonly b?: SideChoice;
  /** A signal or an expression; of B another one if it is called otherwise there. */
  readonly signal: string;
  readonly signalB: string;
  /** s to add to the times of B; undefined: by the clock, or the starts if the clocks do not overlap. */
  readonly offset?: number;
}

const URL_DIGITS = 6;
const LIVE_S = 30;

export const isComparison = ({ page, recording, query = "" }: Route): boolean =>
  page === "recordings" && recording === undefined && /(^|&)a=/.test(query);

export function readComparison(query: string): ComparePlace {
  const given = new URLSearchParams(query);
  const number = (name: string): number | undefined => {
    const value = Number(given.get(name) || NaN);
    return Number.isFinite(value) ? value : undefined;
  };
  const side = (name: "a" | "b"): SideChoice | undefined => {
    const source = given.get(name);
    if (!source) return undefined;
    const [begin, end, last] = [number(`${name}0`), number(`${name}1`), number(`${name}l`)];
    return {
      source,
      device: given.get(`${name}d`) ?? "",
      ...(begin === undefined ? {} : { begin }),
      ...(end === undefined ? {} : { end }),
      ...(last !== undefined && last > 0 ? { last } : {}),
    };
  };
  const b = side("b");
  const offset = number("offset");
  return {
    a: side("a") ?? { source: "", device: "" },
    ...(b ? { b } : {}),
    signal: given.get("signal") ?? "",
    signalB: given.get("signalb") ?? "",
    ...(offset === undefined ? {} : { offset }),
  };
}

export function comparisonHref({ a, b, signal, signalB, offset }: ComparePlace): string {
  const given = new URLSearchParams();
  const put = (name: string, of: SideChoice): void => {
    given.set(name, of.source);
    if (of.device) given.set(`${name}d`, of.device);
    if (of.begin !== undefined) given.set(`${name}0`, of.begin.toFixed(URL_DIGITS));
    if (of.end !== undefined) given.set(`${name}1`, of.end.toFixed(URL_DIGITS));
    if (of.last !== undefined) given.set(`${name}l`, String(of.last));
  };
  put("a", a);
  if (b) put("b", b);
  if (signal) given.set("signal", signal);
  if (signalB) given.set("signalb", signalB);
  if (offset !== undefined) given.set("offset", offset.toFixed(URL_DIGITS));
  return `#/recordings?${given}`;
}

/** The side that a view shows: the stretch between its cursors if both are set; live its window. */
export function sideOf(source: string, device: string, { view, cursor, measure }: ViewState): SideChoice {
  const [pinned, second] = [cursor.peek(), measure.peek()];
  if (pinned?.kind === "pinned" && second !== undefined)
    return { source, device, begin: Math.min(pinned.time, second), end: Math.max(pinned.time, second) };
  if (device !== "") return { source, device };
  const { live, end, span } = view.peek();
  return live ? { source, device, last: Math.max(span, LIVE_S) } : { source, device, begin: end - span, end };
}

/** Opens the comparison of what a view shows; `recording`: the one that it shows, of several devices. */
export function compareView(viewState: ViewState, device: string, recording?: string): void {
  const a = recording === undefined ? sideOf(device, "", viewState) : sideOf(recording, device, viewState);
  location.hash = comparisonHref({ a, signal: "", signalB: "" });
}

/** The side that A is most likely compared with: another live device, then a recording of the same product, then A itself. */
export function likelyOther(
  a: SideChoice,
  product: string,
  devices: readonly DeviceInfo[],
  recordings: readonly RecordingInfo[],
): SideChoice {
  const live = devices.filter(({ id, status }) => id !== a.source && status === "live");
  const alike = live.find((one) => one.product === product && product !== "");
  const chosen = alike ?? (recordings.some(({ id }) => id === a.source) ? undefined : live[0]);
  if (chosen) return { source: chosen.id, device: "", last: a.last ?? LIVE_S };
  const known = recordings.filter((one) => one.id !== a.source && one.deleted === null && !one.recording);
  const same = known.find((one) => one.devices.some((device) => device.product === product && product !== ""));
  const recording = same ?? known[0];
  return recording ? { source: recording.id, device: "" } : a;
}

/** The range of a side as it is requested now. */
export function requestedSide({ source, device, begin, end, last }: SideChoice, now: number): ComparedSide {
  if (last !== undefined) return { source, device, t0: now - last, t1: now };
  return { source, device, t0: begin ?? null, t1: end ?? null };
}

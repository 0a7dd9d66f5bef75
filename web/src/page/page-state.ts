/** State of the page, computed from the server's messages; pages/empty-states.tsx shows each. Pure. */
import type { DeviceInfo, DeviceStatus } from "../wire/types";
import { COMMON } from "../texts/common";

export type PageState =
  | "starting" // nothing has been received from the server yet
  | "empty" // no device is configured
  | "connecting" // trying; no sample yet
  | "denied" // the system does not let us open the port
  | "unreached" // lost before its first sample
  | "loading" // samples come to the server; the page has none of them yet
  | "silent" // open, but no sample ever came
  | "live" // samples come
  | "idle" // open and quiet, with samples from before
  | "lost" // was live, is gone
  | "ended"; // a file that has played to its end

/** The state of the page for the selected device. `seen`: at least one sample of it is in memory. */
export function pageState(greeted: boolean, devices: number, device: DeviceInfo | undefined, seen: boolean): PageState {
  if (!greeted) return "starting";
  if (devices === 0 || !device) return "empty";
  return byStatus(device.status, seen);
}

function byStatus(status: DeviceStatus, seen: boolean): PageState {
  switch (status) {
    case "live":
      return seen ? "live" : "loading";
    case "idle":
      return seen ? "idle" : "silent";
    case "connecting":
      return seen ? "lost" : "connecting";
    case "denied":
      return "denied";
    case "lost":
      return seen ? "lost" : "unreached";
    case "ended":
      return seen ? "ended" : "unreached";
  }
}

/** States whose plots are on screen; in the others a card takes their place. */
export function showsPlots(state: PageState): boolean {
  return state === "live" || state === "idle" || state === "lost" || state === "ended";
}

/** States in which the newest value is old, and shown grey. */
export function isHeld(state: PageState): boolean {
  return state === "lost" || state === "idle" || state === "ended";
}

/** The mark of a device in the rail: shape and word (normal has no colour). `gaps`: lost samples within the last minute. */
export function markOf(
  status: DeviceStatus,
  gaps: number,
): { readonly dot: "live" | "warn" | "bad" | "off"; readonly word: string } {
  switch (status) {
    case "live":
      return gaps > 0 ? { dot: "warn", word: COMMON.status.liveWithGaps } : { dot: "live", word: COMMON.status.live };
    case "connecting":
      return { dot: "off", word: COMMON.status.connecting };
    case "idle":
      return { dot: "off", word: COMMON.status.idle };
    case "ended":
      return { dot: "off", word: COMMON.status.ended };
    case "denied":
      return { dot: "bad", word: COMMON.status.denied };
    case "lost":
      return { dot: "bad", word: COMMON.status.lost };
  }
}

/** The last part of a source, short enough for the rail: "ttyUSB0", "tcp 10.0.7.21:2000", "mti_100hz.bin". */
export function shortSource(source: string): string {
  const [bare = source] = source.split("?");
  const scheme = /^([a-z-]+):\/\/(.*)$/.exec(bare);
  const rest = scheme?.[2] ?? bare;
  if (scheme && scheme[1] !== "serial" && scheme[1] !== "file") return `${scheme[1]} ${rest}`;
  if (rest.startsWith("/dev/")) return rest.slice("/dev/".length); // pts/4 is not "4"
  return rest.split("/").filter(Boolean).at(-1) ?? source;
}

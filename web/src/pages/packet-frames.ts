/** Frames of a device around a moment: those of a live device from memory, those of a recording from its file. */
import type { PacketAt } from "../page/context";
import { type Outcome, request } from "../requests/http";
import type { PacketInfo, PacketView } from "../wire/routes";
import { TEXT } from "../texts/packets";

/** What is asked for: a sample first, then frames by their arrival and place among those that arrived together. */
export interface FramesAsk {
  readonly time: number;
  readonly base: "device" | "arrival";
  readonly channel?: number;
  readonly rank?: number;
  readonly kind?: "reject";
  /** Neighbours on each side. */
  readonly beside: number;
}

export function fetchFrames(
  { device, recording }: Pick<PacketAt, "device" | "recording">,
  query: FramesAsk,
): Promise<Outcome<PacketView>> {
  return recording === undefined
    ? request("GET /api/devices/{device}/frames", { path: { device: device.split(".")[0] ?? device }, query })
    : request("GET /api/recordings/{recording}/frames", { path: { recording }, query: { ...query, device } });
}

export const packetTitle = ({ kind, name }: PacketInfo): string => name || TEXT.kind[kind];

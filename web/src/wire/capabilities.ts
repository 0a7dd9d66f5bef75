/**
 * Capabilities of the server: its protocols, export formats and kinds of links, from its greeting. Everything that the page offers
 * of them comes from here, so that a protocol, a format or a link is added to the server alone.
 */
import { computed, signal } from "@preact/signals";
import type { Capabilities, LinkCapability, ProtocolCapability } from "./capability-types";
import type { ChannelInfo, DeviceInfo } from "./types";

/** Nothing is known before the server has greeted. */
export const capabilities = signal<Capabilities>({ protocols: [], exports: [], links: [], absent: [] });

/** Whether the token of this page may only look: from the greeting, or from a refusal. What would be refused is not offered. */
export const isViewOnly = signal(false);

const byName = computed(() => new Map(capabilities.value.protocols.map((one) => [one.name, one])));

/** The protocol of that name; undefined where the server has none. */
export function protocolOf(name: string | undefined): ProtocolCapability | undefined {
  return byName.value.get(name ?? "");
}

/** The kind of link of that name; undefined where the server has none. */
export function linkNamed(name: string): LinkCapability | undefined {
  return capabilities.value.links.find((one) => one.name === name);
}

/** The protocol of a device that is known by the messages of its driver only: nothing but their numbers. */
export const MESSAGES = "messages";

/** Whether samples that a device lost are counted: none lost then means that none are missing. `channels`: what it sends. */
export function countsLosses(
  device: Pick<DeviceInfo, "protocol" | "link"> | undefined,
  channels: readonly Pick<ChannelInfo, "name">[],
): boolean {
  if (device?.protocol === MESSAGES) return linkNamed(device.link)?.counts_messages ?? false;
  const protocol = protocolOf(device?.protocol);
  return (
    protocol?.counts_losses === true && (!protocol.counter || channels.some(({ name }) => name === protocol.counter))
  );
}

/** The protocols of a receiver alone, "UBX" or "NMEA": all that it sends; none if a family sends anything. */
export function embeddedKinds(channels: readonly Pick<ChannelInfo, "group">[]): ReadonlySet<string> {
  const kinds = channels.map(({ group }) => /^(UBX|NMEA|RTCM3) /.exec(group)?.[1]);
  return new Set(kinds.every((kind) => kind !== undefined) ? kinds : []);
}

/** Parts of constants that the protocols leave in capitals. */
export const abbreviations = computed<ReadonlySet<string>>(
  () => new Set(capabilities.value.protocols.flatMap((one) => one.abbreviations)),
);

/** The protocol of one of these devices. */
export function protocolAmong(
  devices: readonly DeviceInfo[],
  device: string | undefined,
): ProtocolCapability | undefined {
  return protocolOf(devices.find(({ id }) => id === device)?.protocol);
}

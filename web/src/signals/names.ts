/** Signals by the names that the server knows them by. Pure. */
import type { Channel } from "../data/channels";
import type { ChannelInfo } from "../wire/types";

const PLAIN = /^[\p{L}_]\w*(\.\w+)*$/u;

/** A name as an expression has it: in quotation marks if it has spaces, signs or a device. */
export function quoted(name: string): string {
  return PLAIN.test(name) ? name : `"${name}"`;
}

/** Whether a channel is the Euler angles that the page derives from a quaternion. */
export function isOfQuaternion({ info }: Channel, channels: readonly Channel[]): boolean {
  return (
    info.kind === "euler" && channels.some((one) => one.info.id === -1 - info.id && one.info.kind === "quaternion")
  );
}

/** Whether another message of the device has a channel of that name. */
export function isShared(info: ChannelInfo, infos: readonly ChannelInfo[]): boolean {
  return infos.some(
    ({ name, device, message }) => name === info.name && device === info.device && message !== info.message,
  );
}

export function isComputed({ message }: Pick<ChannelInfo, "message">): boolean {
  return message === "expression";
}

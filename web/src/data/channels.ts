/**
 * The channels of the page: each quantity of each device with the ring of its samples, shown in one frame of reference.
 *
 *     add ──▶ one source for each id sent ──arrange──▶ living: of one message and name the newest, and Euler angles where none are sent
 *     take ──norm──▶ change of frame ──▶ Ring of the channel
 *                                   └──Euler angles──▶ Ring of the derived channel (negative id)
 *
 * A ring holds its samples as displayed. When another frame is chosen its rows are changed in place (data/frames.ts), and later
 * samples are changed on arrival.
 */
import { signal, type Signal } from "@preact/signals";
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo } from "../wire/types";
import type { WorldFrame } from "./rotations";
import { addNorm, changedFrame, eulerFrame, eulerInfo, isRotation, normOf, withNorm } from "./derived-channels";
import { type FrameChange, frameChange, infoIn, worldOf } from "./frames";
import type { HeldRange } from "./past";
import type { Ring } from "./ring-buffer";

/** One quantity of one device and its samples. */
export interface Channel {
  readonly info: ChannelInfo;
  readonly ring: Ring;
}

interface Source extends Channel {
  /** Columns whose norm is added, if any. */
  readonly norm: readonly number[] | undefined;
  /** As sent; `info` is as displayed. */
  readonly sent: ChannelInfo;
  /** The display frame; undefined: as sent. */
  readonly world: WorldFrame | undefined;
  /** From the sent to the displayed form, if the frames differ. */
  readonly change: FrameChange | undefined;
}

/**
 * Of a quantity that came both ways, the verified channel precedes the unverified one (its name with a "?"): a key given later
 * changes what is displayed, and earlier data stays available.
 */
export function verifiedFirst(channels: readonly Channel[]): readonly Channel[] {
  const verified = new Set(
    channels.filter(({ info }) => info.verified).map(({ info }) => `${info.device} ${info.name}`),
  );
  const isOld = ({ info }: Channel): boolean =>
    !info.verified && verified.has(`${info.device} ${info.name.replace(/\?$/, "")}`);
  return [...channels.filter((channel) => !isOld(channel)), ...channels.filter(isOld)];
}

export class ChannelRegistry {
  readonly living: Signal<readonly Channel[]> = signal([]);
  readonly #sources = new Map<number, Source>();
  readonly #derived = new Map<number, Channel>();
  /** The messages that each name of each device came in. */
  readonly #messages = new Map<string, Set<string>>();
  /** Display frame of all channels; undefined: as each device sends it. */
  #frame: WorldFrame | undefined;
  readonly #ringOf: (info: ChannelInfo) => Ring;

  /** @param ringOf the ring for a new channel */
  constructor(ringOf: (info: ChannelInfo) => Ring) {
    this.#ringOf = ringOf;
  }

  /** Whether no channel has been sent yet. */
  get isEmpty(): boolean {
    return this.#sources.size === 0;
  }

  /** The channel sent under that id, as displayed. */
  source(id: number): Channel | undefined {
    return this.#sources.get(id);
  }

  /** The channel under that id as the device sends it, without what the page adds. */
  sent(id: number): ChannelInfo | undefined {
    const source = this.#sources.get(id);
    return source && (source.norm ? { ...source.sent, columns: source.sent.columns.slice(0, -1) } : source.sent);
  }

  /** Whether another message of its device has sent a channel of that name. */
  isShared({ device, name }: ChannelInfo): boolean {
    return (this.#messages.get(`${device} ${name}`)?.size ?? 0) > 1;
  }

  /** The rings of a device, including derived channels. */
  ringsOf(device: string): readonly Ring[] {
    return [...this.#sources.values(), ...this.#derived.values()]
      .filter(({ info }) => info.device === device)
      .map(({ ring }) => ring);
  }

  /** Samples dropped for this browser, all channels together. */
  dropped(): number {
    let sum = 0;
    for (const { ring } of this.#sources.values()) sum += ring.dropped;
    return sum;
  }

  /** Add new channels; known ones stay. */
  add(infos: readonly ChannelInfo[]): void {
    for (const plain of infos) {
      const key = `${plain.device} ${plain.name}`;
      const messages = (this.#messages.get(key) ?? new Set()).add(plain.message);
      this.#messages.set(key, messages);
      if (this.#sources.has(plain.id)) continue;
      const [first] = messages;
      // of another message, it is named as the server takes it: two of one name are never one
      const name = plain.message === first ? plain.name : `${plain.message}/${plain.name}`;
      const sent = withNorm({ ...plain, name });
      this.#sources.set(sent.id, {
        info: sent,
        sent,
        norm: normOf(plain),
        ring: this.#ringOf(sent),
        world: undefined,
        change: undefined,
      });
    }
    this.#arrange();
  }

  /** Put a frame into the rings of its channel. `bounds`: its rows are alternately the least and the greatest of intervals. */
  take(frame: SampleFrame, bounds = false): void {
    const source = this.#sources.get(frame.channel);
    if (source === undefined) return;
    const sent = source.norm === undefined ? frame : addNorm(frame, source.norm, bounds);
    const shown = source.change === undefined ? sent : changedFrame(sent, source.change, source.info.columns);
    source.ring.take(shown);
    this.#derived.get(frame.channel)?.ring.take(eulerFrame(shown));
  }

  /** All rings, converted to the frames that the devices send; the chosen frame stays for later samples. */
  held(): readonly HeldRange[] {
    const frame = this.#frame;
    this.showIn(undefined); // rings are kept as their devices send
    this.#frame = frame;
    const sent = [...this.#sources.values()].map(({ sent, ring }) => ({ info: sent, ring }));
    return [...sent, ...[...this.#derived.values()].map(({ info, ring }) => ({ info, ring }))];
  }

  /** Forget a channel that was removed. */
  remove(device: string, name: string): void {
    for (const [id, { info, ring }] of this.#sources) {
      if (info.device !== device || info.name !== name) continue;
      ring.release();
      this.#sources.delete(id);
    }
    this.#arrange();
  }

  /** Forget all channels; their rings have been handed over. */
  clear(): void {
    this.#sources.clear();
    this.#messages.clear();
    this.#derived.clear();
    this.living.value = [];
  }

  /** The world frame of a device's attitude; undefined without attitude. */
  nativeFrame(device: string): WorldFrame | undefined {
    const own = [...this.#sources.values()]
      .map(({ sent }) => sent)
      .filter((sent) => sent.device === device && ["quaternion", "matrix", "euler"].includes(sent.kind));
    const worlds = own.map(worldOf).filter((world) => world !== undefined);
    return (
      worlds[0] ?? (own.some(({ frame }) => frame.startsWith("ECEF")) ? "NED" : own.length > 0 ? "ENU" : undefined)
    );
  }

  /** Display everything in that frame, or as sent; stored samples are converted. */
  showIn(frame: WorldFrame | undefined): void {
    if (frame === this.#frame) return;
    this.#frame = frame;
    this.#arrange();
  }

  /** The frame change of a channel; undefined if there is none. */
  changeOf(channel: number): FrameChange | undefined {
    return this.#sources.get(channel)?.change;
  }

  /** Bring every channel into the chosen frame: its rows, later samples, and its names. */
  #present(): void {
    for (const [id, source] of this.#sources) {
      const { sent, ring, world } = source;
      const native = worldOf(sent) ?? this.nativeFrame(sent.device);
      if (native === undefined) continue;
      const to = this.#frame ?? native;
      const now = world ?? native;
      if (now === to) continue;
      const back = frameChange(sent, now, to);
      if (back) ring.transform(back);
      const derived = this.#derived.get(id);
      if (derived) {
        const turn = frameChange(derived.info, now, to);
        if (turn) derived.ring.transform(turn);
        this.#derived.set(id, { ...derived, info: eulerInfo(infoIn(sent, native, to)) });
      }
      this.#sources.set(id, {
        ...source,
        info: infoIn(sent, native, to),
        world: to,
        change: frameChange(sent, native, to),
      });
    }
  }

  /** Select the newest of channels with one name, in the chosen frame; derive Euler angles if a device sends none. */
  #arrange(): void {
    this.#present();
    const living = new Map<string, Channel>();
    for (const source of this.#sources.values()) {
      const key = `${source.info.device} ${source.info.name}`;
      const other = living.get(key);
      if (other === undefined || other.info.id < source.info.id) living.set(key, source);
    }
    const kept = [...living.values()];
    for (const [id, { ring }] of this.#sources) {
      if (kept.some(({ info }) => info.id === id)) continue;
      ring.release();
      this.#sources.delete(id);
    }
    for (const device of new Set(kept.map(({ info }) => info.device))) {
      const own = kept.filter(({ info }) => info.device === device);
      const source = own.some(({ info }) => info.kind === "euler") ? undefined : this.#rotation(own);
      for (const [id, { info, ring }] of this.#derived) {
        if (info.device !== device || id === source?.info.id) continue;
        ring.release();
        this.#derived.delete(id);
      }
      if (source === undefined) continue;
      if (!this.#derived.has(source.info.id)) this.#derived.set(source.info.id, this.#euler(source.info.id));
    }
    this.living.value = verifiedFirst([...kept, ...this.#derived.values()]);
  }

  /** The Euler angles of a source: empty, or those from before the server restarted. */
  #euler(id: number): Channel {
    const { info, sent, world } = this.#sources.get(id)!;
    const native = eulerInfo(sent);
    const ring = this.#ringOf(native);
    const from = worldOf(sent);
    const change = from && world ? frameChange(native, from, world) : undefined;
    if (change && ring.length > 0) ring.transform(change);
    return { info: eulerInfo(info), ring };
  }

  #rotation(channels: readonly Channel[]): Channel | undefined {
    const rotations = verifiedFirst(channels).filter(({ info }) => isRotation(info));
    return rotations.find(({ info }) => info.kind === "quaternion") ?? rotations[0];
  }
}

/** Times of the first and the last sample; undefined without one. */
export function sampledSpan(
  channels: readonly Channel[],
): { readonly first: number; readonly last: number } | undefined {
  const rings = channels.map(({ ring }) => ring).filter(({ length }) => length > 0);
  if (rings.length === 0) return undefined;
  return {
    first: Math.min(...rings.map((ring) => ring.time(0))),
    last: Math.max(...rings.map((ring) => ring.time(ring.length - 1))),
  };
}

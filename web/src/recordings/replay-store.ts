/**
 * A recording as a store like the live one, for panels made for live devices: devices, channels, events and rings. Only its rings are
 * filled a range at a time, from the answer to one request, and "now" is the reading position.
 *
 *     GET …/window ──decode──▶ show ──clear, keep──▶ Ring of the channel ──▶ the plots and panels that are on Live
 *
 * A range with more samples than requested is summarised: two rows at one time, the least and the greatest (of flags those of any
 * row, and of all). Rings draw them like dense samples; `range_query.py` is the other end.
 */
import type { Channel } from "../data/channels";
import { GAP_STEPS } from "../data/line-breaks";
import { Store } from "../data/store";
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo, Dtype, EventInfo } from "../wire/types";
import type { Stretch } from "./time-range";
import type { RecordingDetail } from "../wire/recording-types";

/** Added to the spacing of summarised rows, in usual spacings. */
const BREAK_FACTOR = 2.5;

/** Whether these rows bound intervals. Samples never share their times in pairs; tables and attitudes are not summarised. */
export function isBounds(frame: SampleFrame, kind: ChannelInfo["kind"]): boolean {
  if (frame.n === 0 || frame.n % 2 !== 0 || kind === "table" || kind === "quaternion" || kind === "matrix")
    return false;
  for (let i = 0; i < frame.n; i += 2) if (frame.time[i] !== frame.time[i + 1]) return false;
  return true;
}

/** The recording's channel for a channel of the store, or the source of a derived one. */
const sourceOf = ({ id }: ChannelInfo): number => (id < 0 ? -1 - id : id);

export class ReplayStore extends Store {
  readonly #now: () => number;
  readonly #infos: ReadonlyMap<number, ChannelInfo>;
  readonly #usual: Readonly<Record<string, number>>;
  readonly #steps: readonly EventInfo[];

  /** @param now reading position, unix s */
  constructor(detail: Pick<RecordingDetail, "devices" | "channels" | "events" | "longest_s">, now: () => number) {
    super();
    this.#now = now;
    this.#usual = detail.longest_s;
    this.#infos = new Map(detail.channels.map((info) => [info.id, info]));
    this.#steps = detail.events.filter(({ kind, device }) => kind === "clock" && device !== "");
    this.connection.value = "open";
    this.receive({ kind: "text", text: { op: "devices", devices: [...detail.devices] } });
    this.receive({ kind: "text", text: { op: "channels", channels: [...detail.channels] } });
    this.receive({ kind: "text", text: { op: "events", events: [...detail.events] } });
  }

  override serverNow(): number {
    return this.#now();
  }

  /** A recording has ended, but not at the reading position: its rings hold a part of it. */
  override edgeOf(): number {
    return this.#now();
  }

  /** The dtypes of a channel's columns, for decoding. */
  dtypesOf = (channel: number): readonly Dtype[] | undefined =>
    this.#infos.get(channel)?.columns.map(({ dtype }) => dtype);

  /** Drop all channels other than these. */
  keepOnly(channels: readonly number[]): void {
    for (const { info, ring } of this.channels.peek())
      if (ring.length > 0 && !channels.includes(sourceOf(info))) ring.clear();
  }

  /** Drop these channels. */
  forget(channels: readonly number[]): void {
    for (const { info, ring } of this.channels.peek()) if (channels.includes(sourceOf(info))) ring.clear();
  }

  /** Replace the samples of these channels by those of this range. */
  show(channels: readonly number[], frames: readonly SampleFrame[], stretch: Stretch, exact: boolean): void {
    const mine = this.channels.peek().filter(({ info }) => channels.includes(sourceOf(info)));
    const shown = new Map(frames.map((frame) => [frame.channel, frame]));
    const bucket = stretch.width > 0 ? (stretch.t1 - stretch.t0) / stretch.width : 0;
    for (const { info, ring } of mine) {
      const frame = shown.get(sourceOf(info));
      // the spacing of thinned or summarised rows is meaningless; the server gives the channel's usual one
      ring.clear(exact ? NaN : this.#longest(sourceOf(info), frame, bucket));
    }
    for (const frame of frames) {
      const kind = this.#infos.get(frame.channel)?.kind;
      this.appendFrame(
        { ...frame, sequence: 0, history: false, dropped: 0 },
        !exact && kind !== undefined && isBounds(frame, kind),
      );
    }
    for (const channel of mine) {
      for (const { device, time } of this.#steps) if (device === channel.info.device) channel.ring.cut(time);
      if (exact) this.#cutLosses(channel, stretch);
    }
  }

  /** Break lines at losses. One lost sample leaves a spacing that could be jitter; the device's counter decides. */
  #cutLosses({ info, ring }: Channel, { t0, t1 }: Stretch): void {
    const usual = this.#usual[String(sourceOf(info))] ?? 0;
    if (usual <= 0) return;
    for (const loss of this.losses(info.device)) {
      if (loss.t1 < t0 || loss.t0 > t1) continue;
      const middle = (loss.t0 + loss.t1) / 2;
      const i = ring.row(middle, "device") - ring.first;
      if (i > 0 && i < ring.length && ring.time(i) - ring.time(i - 1) > GAP_STEPS * usual) ring.cut(middle);
    }
  }

  /** Summaries of neighbouring intervals start up to one and a half of them apart; thinned rows somewhat more than evenly. */
  #longest(id: number, frame: SampleFrame | undefined, bucket: number): number {
    const usual = this.#usual[String(id)] ?? 0;
    const thinned =
      frame === undefined || frame.n < 2 ? 0 : (frame.time[frame.n - 1]! - frame.time[0]!) / (frame.n - 1);
    return 1.5 * Math.max(bucket, thinned === thinned ? thinned : 0) + BREAK_FACTOR * usual;
  }
}

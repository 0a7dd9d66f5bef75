/**
 * What is missing, and who lost it? Gap events say what counters found missing between device and host; `dropped` in the frames
 * says what the server did not send to this browser. Both are spans of time that every plot hatches.
 */
import type { ChannelInfo, EventInfo } from "../wire/types";

export interface Loss {
  /** Span concerned, unix s (host time). */
  readonly t0: number;
  readonly t1: number;
  readonly samples: number;
  /** Who lost it: on the way to the host, between the server and this browser, or a server that was not there. */
  readonly by: "device" | "browser" | "server";
  readonly text: string;
}

/** Losses kept of one device; the oldest go first. */
const KEPT = 8000;

export class LossBook {
  readonly #of = new Map<string, Loss[]>();

  of(device: string): readonly Loss[] {
    return this.#of.get(device) ?? [];
  }

  addEvents(events: readonly EventInfo[]): void {
    for (const { kind, t0, t1, device, samples, text } of events) {
      if (kind === "gap" && t0 !== null && t1 !== null) this.#add(device, { t0, t1, samples, by: "device", text });
    }
  }

  /** `samples` of a channel were dropped for this browser between `t0` and `t1`. Channels of one device share a moment. */
  addDrop(info: ChannelInfo, t0: number, t1: number, samples: number): void {
    if (!(t0 <= t1)) return;
    const list = this.#list(info.device);
    const at = list.findLastIndex((loss) => loss.by === "browser" && loss.t1 >= t0 && loss.t0 <= t1);
    const same = list[at];
    const [from, to, most] = [Math.min(t0, same?.t0 ?? t0), Math.max(t1, same?.t1 ?? t1), Math.max(samples, same?.samples ?? 0)];
    if (same !== undefined) list.splice(at, 1);
    this.#add(info.device, { t0: from, t1: to, samples: most, by: "browser", text: "Dropped for this browser: it did not keep up." });
  }

  /** What an earlier run of the server knew of a device. */
  addAll(device: string, losses: readonly Loss[]): void {
    for (const loss of losses) this.#add(device, loss);
  }

  /** There was no server between `t0` and `t1`: what a device sent meanwhile nobody knows. */
  addRestart(device: string, t0: number, t1: number): void {
    if (t0 < t1) this.#add(device, { t0, t1, samples: 0, by: "server", text: "The imuscope server was restarted; what was sent meanwhile is not here." });
  }

  forget(device: string): void {
    this.#of.delete(device);
  }

  #list(device: string): Loss[] {
    let list = this.#of.get(device);
    if (list === undefined) this.#of.set(device, (list = []));
    return list;
  }

  #add(device: string, loss: Loss): void {
    const list = this.#list(device);
    let at = list.length;
    while (at > 0 && list[at - 1]!.t0 > loss.t0) at--;
    list.splice(at, 0, loss);
    if (list.length > KEPT) list.shift();
  }
}

/**
 * Missing data and its cause. Gap events report what counters found missing between device and host; `dropped` in the frames
 * counts what the server did not send to this browser. Both are time intervals that every plot hatches.
 */
import type { ChannelInfo, EventInfo } from "../wire/types";
import { TEXT } from "../texts/plots";

export interface Loss {
  /** Affected interval, unix s (host time). */
  readonly t0: number;
  readonly t1: number;
  readonly samples: number;
  /** Where it was lost: on the way to the host, between server and browser, or while the server was down. */
  readonly by: "device" | "browser" | "server";
  readonly text: string;
}

/** Losses kept of one device; the oldest go first. */
const MAX_LOSSES = 8000;

export class LossList {
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
    const [from, to, most] = [
      Math.min(t0, same?.t0 ?? t0),
      Math.max(t1, same?.t1 ?? t1),
      Math.max(samples, same?.samples ?? 0),
    ];
    if (same !== undefined) list.splice(at, 1);
    this.#add(info.device, { t0: from, t1: to, samples: most, by: "browser", text: TEXT.droppedForBrowser });
  }

  /** Add the losses of a device known to an earlier run of the server. */
  addAll(device: string, losses: readonly Loss[]): void {
    for (const loss of losses) this.#add(device, loss);
  }

  /** The server was down between `t0` and `t1`: what the device sent in between is unknown. */
  addRestart(device: string, t0: number, t1: number): void {
    if (t0 < t1) this.#add(device, { t0, t1, samples: 0, by: "server", text: TEXT.serverRestartedGap });
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
    if (list.length > MAX_LOSSES) list.shift();
  }
}

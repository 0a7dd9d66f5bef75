/** Access to the samples of any range of an open recording, of which the page holds only some. */
import type { Channel } from "../data/channels";
import type { Ring } from "../data/ring-buffer";
import type { Store } from "../data/store";
import type { Reads } from "../data/view";
import type { FigureSource } from "./figure-source";

/** The server's signals of a live device. */
export function liveSource(store: Pick<Store, "sent" | "changeOf" | "isShared">, device: string): FigureSource {
  return {
    id: device,
    prefix: (info) => (store.isShared(info) ? `${info.message}/` : ""),
    sent: (id) => store.sent(id),
    changeOf: (id) => store.changeOf(id),
  };
}

export interface SampleAccess {
  /** What is on screen, at screen resolution. */
  readonly drawn: Store;
  /** As the plots' (plot-stack.ts). */
  readonly reads: Reads;
  /** The ring with all samples of a channel in a range; undefined: the server has them. */
  readonly ringOf: (channel: Channel, t0: number, t1: number) => Ring | undefined;
  /** The server's signals. */
  readonly source: FigureSource;
}

/** Messages between the page and its socket worker. */
import type { SampleFrame } from "./codec";
import type { ServerText } from "./types";

export type ToWorker =
  | { readonly kind: "start"; readonly url: string /** Most seconds of history wanted. */; readonly history: number }
  /** The page draws every `seconds`: samples need not come more often. */
  | { readonly kind: "interval"; readonly seconds: number }
  | { readonly kind: "stop" }
  | { readonly kind: "retry" };

export type FromWorker =
  | {
      readonly kind: "connection";
      readonly state: "connecting" | "open" | "closed" /** Unix seconds by our clock. */;
      readonly nextTry: number | undefined;
    }
  /** A subscription was sent. `fresh`: earlier data belongs to another server run; else it stays and the gap is filled. */
  | { readonly kind: "subscribed"; readonly fresh: boolean }
  | { readonly kind: "text"; readonly text: ServerText }
  /** Sample frames of one message; `received` is the server's clock when they were decoded, s (NaN before the clock is known). */
  | { readonly kind: "frames"; readonly frames: readonly SampleFrame[]; readonly received: number }
  /** Start of silence on an open connection, unix seconds by our clock; undefined: messages arrive again. */
  | { readonly kind: "silence"; readonly since: number | undefined }
  | { readonly kind: "clock"; readonly offset: number; readonly uncertainty: number }
  /** Of the latest ping: from this page to the server and back. */
  | { readonly kind: "round-trip"; readonly seconds: number }
  | { readonly kind: "problem"; readonly message: string };

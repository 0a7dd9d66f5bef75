/** What the page and its socket worker say to each other. */
import type { SampleFrame } from "./codec";
import type { ServerText } from "./types";

export type ToWorker =
  | { readonly kind: "start"; readonly url: string; /** Most seconds of history wanted. */ readonly history: number }
  /** The page draws every `seconds`: samples need not come more often. */
  | { readonly kind: "interval"; readonly seconds: number }
  | { readonly kind: "stop" }
  | { readonly kind: "retry" };

export type FromWorker =
  | { readonly kind: "connection"; readonly state: "connecting" | "open" | "closed"; /** Unix seconds by our clock. */ readonly nextTry: number | undefined }
  /** A subscription was sent. `fresh`: nothing held before belongs to this server run; else what is held stays and the gap is filled. */
  | { readonly kind: "subscribed"; readonly fresh: boolean }
  | { readonly kind: "text"; readonly text: ServerText }
  /** Sample frames of one message; `received` is the server's clock when the typed arrays stood, s (NaN before the clock is known). */
  | { readonly kind: "frames"; readonly frames: readonly SampleFrame[]; readonly received: number }
  /** Nothing comes over an open connection since then, unix seconds by our clock; undefined: it is heard again. */
  | { readonly kind: "silence"; readonly since: number | undefined }
  | { readonly kind: "clock"; readonly offset: number; readonly uncertainty: number }
  | { readonly kind: "problem"; readonly message: string };

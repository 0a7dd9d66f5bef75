/**
 * Recorded messages of a real server to a newly opened page, for component tests: texts and sample frames of its WebSocket, and its
 * HTTP answers. `python -m tests.web.record_wire` records them.
 */
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { gunzipSync } from "node:zlib";
import { vi } from "vitest";
import type { Store } from "../data/store";
import { decode } from "../wire/codec";
import type { Dtype, ServerText } from "../wire/types";

export type Family = "xbus" | "isb" | "idtp";

/** Further recordings: tests/web/wire_scenes.py describes each. */
export type Scene =
  | "attitude-ins-1"
  | "attitude-ins-2"
  | "attitude-ins-4"
  | "attitude-imu-quat"
  | "secure"
  | "unverified"
  | "shared-link"
  | "waiting"
  | "two-senders"
  | "library"
  | "recordings";

/**
 * "GET /api/devices/1/values", or with a body "POST /api/devices/1/preview {…}" → the answer; a function of the query where the answer
 * depends on it.
 */
export type Answers = Readonly<Record<string, unknown>>;

export interface Recorded {
  readonly texts: readonly ServerText[];
  readonly samples: readonly string[];
  /** The texts after the settings were read. */
  readonly read?: readonly ServerText[];
  readonly unread: Answers;
  readonly answers: Answers;
  /** All samples of each recording, as on the wire: base64. */
  readonly windows?: Readonly<Record<string, string>>;
}

const FOLDER = join(import.meta.dirname, "../../../tests/golden/wire");

export function recorded(name: Family | Scene): Recorded {
  return JSON.parse(gunzipSync(readFileSync(join(FOLDER, `page-${name}.json.gz`))).toString()) as Recorded;
}

/** Feeds a store with everything recorded, as its socket worker would. */
export function feed(store: Store, { samples }: Pick<Recorded, "samples">, texts: readonly ServerText[]): void {
  store.receive({ kind: "connection", state: "open", nextTry: undefined });
  store.receive({ kind: "subscribed", fresh: true });
  const dtypes = new Map<number, readonly Dtype[]>();
  for (const text of texts) {
    if (text.op === "channels")
      for (const { id, columns } of text.channels)
        dtypes.set(
          id,
          columns.map(({ dtype }) => dtype),
        );
    store.receive({ kind: "text", text });
  }
  for (const sample of samples) {
    const { frames, problem } = decode(bytesOf(sample).buffer, (channel) => dtypes.get(channel));
    if (problem !== undefined) throw new Error(problem);
    store.receive({ kind: "frames", frames, received: Number.NaN });
  }
}

/** The key of each recorded device, and its id. */
export const keysOf = (texts: readonly ServerText[]): ReadonlyMap<string, string> =>
  new Map(
    texts.flatMap((text) => (text.op === "devices" ? text.devices.map(({ key, id }) => [key, id] as const) : [])),
  );

export const bytesOf = (base64: string): Uint8Array<ArrayBuffer> => new Uint8Array(Buffer.from(base64, "base64"));

export interface Asked {
  readonly method: string;
  /** With the id of a device in the place of its key. */
  readonly path: string;
  /** As sent. */
  readonly address: string;
  readonly body: unknown;
  /** Cancels it, if it can be cancelled. */
  readonly signal: AbortSignal | undefined;
}

const inOrder = (value: unknown): unknown =>
  Array.isArray(value)
    ? value.map(inOrder)
    : typeof value === "object" && value !== null
      ? Object.fromEntries(
          Object.entries(value)
            .sort(([a], [b]) => (a < b ? -1 : 1))
            .map(([name, part]) => [name, inOrder(part)]),
        )
      : value;

/** Lookup key of an answer: independent of the order of a body's keys. */
function keyOf(text: string): string {
  const cut = text.indexOf(" {");
  return cut < 0 ? text : text.slice(0, cut + 1) + JSON.stringify(inOrder(JSON.parse(text.slice(cut + 1))));
}

/** Time from a request to its answer, in which the page is drawn. */
const [ON_THE_WAY_MS, SLOW_MS] = [5, 200];

/**
 * Answers requests from the recording, late when the path ends with `slow`; others with 404. Returns all requests so far.
 * `keys`: the key of each device, by which requests may name it, and its id.
 */
export function answering(answers: Answers, slow = "", keys: ReadonlyMap<string, string> = new Map()): Asked[] {
  const known = new Map(Object.entries(answers).map(([key, answer]) => [keyOf(key), answer]));
  const asked: Asked[] = [];
  vi.stubGlobal("fetch", (address: string, { method = "GET", body, signal }: RequestInit = {}) => {
    const text = typeof body === "string" ? body : "";
    const path = address.replace(/(?<=^\/api\/devices\/)[^/?]+/, (name) => keys.get(decodeURIComponent(name)) ?? name);
    asked.push({
      method,
      path,
      address,
      body: text === "" ? undefined : JSON.parse(text),
      signal: signal ?? undefined,
    });
    const [place, query] = path.split("?");
    const whole = known.get(keyOf(`${method} ${path} ${text}`.trim())) ?? known.get(`${method} ${path}`);
    const answered = whole ?? known.get(`${method} ${place}`);
    const found: unknown =
      typeof answered === "function" ? answered(new URLSearchParams(query), text && JSON.parse(text)) : answered;
    const missing = { kind: "not-found", message: `Nothing was recorded of ${path}.`, hint: "" };
    const answer =
      found instanceof Response ? found : Response.json(found ?? missing, { status: found === undefined ? 404 : 200 });
    const takes = slow !== "" && path.endsWith(slow) ? SLOW_MS : ON_THE_WAY_MS;
    return new Promise((resolve) => setTimeout(() => resolve(answer), takes));
  });
  return asked;
}

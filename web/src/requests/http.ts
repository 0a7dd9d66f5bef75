/**
 * Requests to the server, typed by its OpenAPI document (wire/routes.ts). Every failure is a Problem with words for a person.
 */
import type { AddDeviceRequest, DecodeOptionsBody, PortInfo, ProblemBody, Routes } from "../wire/routes";
import { isViewOnly } from "../wire/capabilities";
import { contained, parseForeign } from "../wire/foreign-text";
import { COMMON } from "../texts/common";
import { serverRoot } from "./server-place";

/** The only shape of errors: what went wrong, and what to do next. */
export interface HttpProblem extends ProblemBody {
  /** The HTTP status; 0 without an answer. */
  readonly status: number;
}

/** Whether the server is reachable but refuses this page. */
export function isRefusal(problem: HttpProblem): boolean {
  return problem.status === 401 || problem.status === 403;
}

export type Outcome<T> =
  | { readonly ok: true; readonly value: T }
  | { readonly ok: false; readonly problem: HttpProblem };

/** A method and a path as the server's OpenAPI document writes them: "POST /api/devices/{device}/retry". */
type Route = keyof Routes;
type Answer<R extends Route> = Routes[R]["answer"];

/** Input of a route: path, query and body, as far as it has them. */
type Input<R extends Route> = Omit<Routes[R], "answer">;
interface Cancel {
  readonly signal?: AbortSignal;
  /** The revision that a change replaces; "*": any. */
  readonly ifMatch?: string;
}
type Arguments<R extends Route, More> =
  Record<never, never> extends Input<R> ? [input?: Input<R> & More] : [input: Input<R> & More];

interface Parts extends Cancel {
  readonly path?: Readonly<Record<string, string | number>>;
  readonly query?: Readonly<Record<string, string | number | boolean | null | undefined>>;
  readonly body?: unknown;
}

/** The address of a route, for a link or a download. */
export function addressOf<R extends Route>(route: R, ...[input]: Arguments<R, unknown>): string {
  return address(route, (input ?? {}) as Parts);
}

function address(route: Route, { path = {}, query = {} }: Parts): string {
  const place = route
    .slice(route.indexOf(" ") + 1)
    .replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(path[name] ?? ""));
  const given = Object.entries(query).flatMap(([name, value]) =>
    value === undefined || value === null ? [] : [[name, String(value)]],
  );
  const full = serverRoot() + place;
  return given.length > 0 ? `${full}?${new URLSearchParams(given)}` : full;
}

/** One request whose answer is JSON, text, or nothing. */
export async function request<R extends Route>(route: R, ...input: Arguments<R, Cancel>): Promise<Outcome<Answer<R>>> {
  const answer = await respond(route, ...input);
  if (!(answer instanceof Response)) return { ok: false, problem: answer };
  let text: string;
  try {
    text = await answer.text();
  } catch {
    return { ok: false, problem: UNREACHED }; // cancelled, or cut off in the middle of the answer
  }
  const isJson = (answer.headers.get("content-type") ?? "").includes("json");
  return { ok: true, value: (isJson ? parseJson(text) : text === "" ? undefined : contained(text)) as Answer<R> };
}

export const UNREACHED: HttpProblem = {
  kind: "offline",
  message: COMMON.serverSilent,
  hint: COMMON.serverSilentHint,
  status: 0,
};

/** Of a key that changes something, pressed with view-only access. */
export const VIEW_ONLY: HttpProblem = {
  kind: "view-only",
  message: COMMON.viewOnly,
  hint: COMMON.viewOnlyHint,
  status: 403,
};

/** For a server that answers requests although its WebSocket cannot be opened. */
export const NO_SOCKET: HttpProblem = {
  kind: "no-websocket",
  message: COMMON.noSocket,
  hint: COMMON.noSocketHint,
  status: 0,
};

/** The same, for any other kind of answer: its response, once it is known not to be a problem. */
export async function respond<R extends Route>(
  route: R,
  ...[input]: Arguments<R, Cancel>
): Promise<Response | HttpProblem> {
  const parts = (input ?? {}) as Parts;
  const method = route.slice(0, route.indexOf(" "));
  // the server requires JSON for every change, so that no form of another page can make one
  const headers: Record<string, string> = method === "GET" ? {} : { "content-type": "application/json" };
  if (parts.ifMatch !== undefined) headers["if-match"] = parts.ifMatch === "*" ? "*" : `"${parts.ifMatch}"`;
  const body = parts.body === undefined && method === "POST" ? {} : parts.body;
  const content = body === undefined ? {} : { body: JSON.stringify(body) };
  let answer: Response;
  try {
    answer = await fetch(address(route, parts), {
      method,
      credentials: "same-origin",
      headers,
      ...content,
      ...(parts.signal ? { signal: parts.signal } : {}),
    });
  } catch {
    return UNREACHED;
  }
  if (answer.ok) return answer;
  const problem = problemOf(parseJson(await answer.text().catch(() => "")), answer.status);
  if (problem.kind === VIEW_ONLY.kind) isViewOnly.value = true;
  return problem;
}

/** The value of a text in JSON; undefined for any other text. */
export function parseJson(text: string): unknown {
  try {
    return parseForeign(text);
  } catch {
    return undefined;
  }
}

/** The problem in an answer. */
export function problemOf(value: unknown, status: number): HttpProblem {
  const given = (value ?? {}) as Partial<Record<keyof HttpProblem, unknown>>;
  const words = (key: "kind" | "message" | "hint", other: string): string => {
    const text = given[key];
    return typeof text === "string" && text !== "" ? text : other;
  };
  return {
    kind: words("kind", `http-${status}`),
    message: words("message", COMMON.serverAnswered(status)),
    hint: words("hint", ""),
    status,
  };
}

/** Decoding options of a source given by the user, by the names that the server lists. A secret goes to the server and is stored nowhere else. */
export type HowToRead = Readonly<Record<string, string | boolean>>;
export type Port = PortInfo;

export const api = {
  addDevice: (source: string, how: HowToRead = {}) =>
    request("POST /api/devices", { body: { source, ...how } as AddDeviceRequest }),
  /** Given options change from now on; the device, its history and its other options stay. */
  readDevice: (device: string, how: HowToRead) =>
    request("POST /api/devices/{device}/decode-options", { path: { device }, body: how as DecodeOptionsBody }),
  removeDevice: (device: string) => request("DELETE /api/devices/{device}", { path: { device } }),
  nameDevice: (device: string, name: string) =>
    request("PUT /api/devices/{device}/name", { path: { device }, body: { name } }),
  runCommand: (device: string, command: string) =>
    request("POST /api/devices/{device}/run", { path: { device }, body: { command, values: {}, confirmed: false } }),
  retryDevice: (device: string) => request("POST /api/devices/{device}/retry", { path: { device } }),
  /** Accept any sequence number next from a Secure device of this link. */
  rearmDevice: (device: string, sender: string) =>
    request("POST /api/devices/{device}/rearm", { path: { device }, body: { sender } }),
  /** A cheap request that shows why the WebSocket does not open: refused, or unreachable. */
  probe: () => request("GET /api/devices"),
  /** Whether a tile server is configured, and its attribution. */
  map: () => request("GET /api/map"),
  ports: () => request("GET /api/ports"),
  /** Listens on every free port; takes some seconds. */
  scanPorts: () => request("POST /api/ports/scan"),
};

/** The server's HTTP side, as far as this page uses it. Every failure is a Problem with words for a person. */

/** The one shape of errors: what went wrong, and what to do next. */
export interface Problem {
  readonly kind: string;
  readonly message: string;
  readonly hint: string;
  /** The HTTP status; 0 when nobody answered. */
  readonly status: number;
}

/** The server is there and does not let this page in. */
export function isRefusal(problem: Problem): boolean {
  return problem.status === 401 || problem.status === 403;
}

export type Outcome<T> = { readonly ok: true; readonly value: T } | { readonly ok: false; readonly problem: Problem };

/** One request; `path` is below this server. An answer that is no JSON is given as text. */
export async function request<T>(method: "GET" | "POST" | "PUT" | "DELETE", path: string, body?: unknown): Promise<Outcome<T>> {
  let answer: Response;
  try {
    // The server takes JSON only for whatever changes something, so that no form of another page can do it.
    const headers: Record<string, string> = method === "GET" ? {} : { "content-type": "application/json" };
    const content = body === undefined ? {} : { body: JSON.stringify(body) };
    answer = await fetch(path, { method, credentials: "same-origin", headers, ...content });
  } catch {
    const message = "The imuscope server does not answer.";
    return { ok: false, problem: { kind: "offline", message, hint: "Is it still running, and is this machine still on its network?", status: 0 } };
  }
  const text = await answer.text();
  const value = parse(text);
  if (answer.ok) return { ok: true, value: (value ?? text) as T };
  return { ok: false, problem: problemOf(value, answer.status) };
}

function parse(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}

function problemOf(value: unknown, status: number): Problem {
  const given = (value ?? {}) as Partial<Record<keyof Problem, unknown>>;
  const words = (key: "kind" | "message" | "hint", other: string): string => {
    const text = given[key];
    return typeof text === "string" && text !== "" ? text : other;
  };
  return { kind: words("kind", `http-${status}`), message: words("message", `The server answered ${status}.`), hint: words("hint", ""), status };
}

/** One attempt to hear something on a port, in words. */
export interface PortTry {
  readonly what: string;
  readonly outcome: string;
}

/** A serial port of the host. */
export interface Port {
  readonly device: string;
  readonly description: string;
  readonly busy: string;
  readonly denied: string;
  readonly heard: readonly PortTry[];
}

/** How a source is to be read, as far as a person says so. */
export interface HowToRead {
  /** "xbus", "isb", "idtp"; absent: recognised. */
  readonly protocol?: string;
  /** For Secure frames, hex. Goes to the server and is kept nowhere else. */
  readonly key?: string;
  /** Of the timestamps of IDTP; "" for microseconds, unless their arrival says otherwise. */
  readonly time_unit?: string;
  /** Which way the quaternion of an IDTP device turns; "" for body to ENU. */
  readonly rotation?: string;
  /** TOML that describes a vendor's own payload types. */
  readonly schema?: string;
}

export const api = {
  addDevice: (source: string, how: HowToRead = {}) => request<{ readonly id: string }>("POST", "/api/devices", { source, ...how }),
  /** What is given changes from here on; the device, its history and whatever else was said of it stay. */
  readDevice: (id: string, how: HowToRead) => request<{ readonly id: string }>("POST", `/api/devices/${encodeURIComponent(id)}/reading`, how),
  removeDevice: (id: string) => request<unknown>("DELETE", `/api/devices/${encodeURIComponent(id)}`),
  retryDevice: (id: string) => request<unknown>("POST", `/api/devices/${encodeURIComponent(id)}/retry`, {}),
  /** Accept whatever sequence number a Secure device of this link sends next. */
  rearmDevice: (id: string, sender: string) => request<unknown>("POST", `/api/devices/${encodeURIComponent(id)}/rearm`, { sender }),
  /** A cheap request that tells why the WebSocket does not open: refused, or nobody there. */
  probe: () => request<unknown>("GET", "/api/devices"),
  /** Whether a tile server is configured, and whom its tiles are owed to. */
  map: () => request<{ readonly tiles: boolean; readonly attribution: string }>("GET", "/api/map"),
  ports: () => request<readonly Port[]>("GET", "/api/ports"),
  /** Listens on every free port; takes some seconds. */
  scanPorts: () => request<readonly Port[]>("POST", "/api/ports/scan", {}),
};

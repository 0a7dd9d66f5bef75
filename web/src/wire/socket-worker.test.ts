/** The worker's attempts to connect, with a socket and a clock of the test. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import type { FromWorker, ToWorker } from "./worker-messages";

class Socket {
  static readonly OPEN = 1;
  static all: Socket[] = [];
  readyState = 0;
  onopen?: () => void;
  onmessage?: (event: { readonly data: string }) => void;
  onclose?: () => void;
  readonly close = vi.fn();

  constructor() {
    Socket.all.push(this);
  }

  send(): void {}

  open(): void {
    this.readyState = Socket.OPEN;
    this.onopen?.();
  }
}

let told: FromWorker[] = [];
let send: (message: ToWorker) => void;

beforeEach(async () => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "setInterval", "clearInterval", "Date", "performance"] });
  vi.resetModules();
  [Socket.all, told] = [[], []];
  const worker: { onmessage?: (event: { readonly data: ToWorker }) => void; postMessage: unknown } = {
    postMessage: (message: FromWorker) => told.push(message),
  };
  vi.stubGlobal("self", worker);
  vi.stubGlobal("WebSocket", Socket);
  vi.stubGlobal("CloseEvent", class {});
  await import("./socket-worker");
  send = (data) => worker.onmessage?.({ data });
  send({ kind: "start", url: "ws://robot/ws", history: 60 });
});
afterEach(() => {
  send({ kind: "stop" });
});

const states = (): readonly string[] => told.flatMap((one) => (one.kind === "connection" ? [one.state] : []));

it("gives up an attempt that gets no answer, and tries again", () => {
  vi.advanceTimersByTime(12_000);
  expect(Socket.all.length).toBe(2);
  expect(Socket.all[0]?.close).toHaveBeenCalled();
  Socket.all[1]?.open();
  vi.advanceTimersByTime(12_000);
  expect(Socket.all.length).toBe(2); // an open one stays
});

it("tries at once on request, in the place of an attempt that hangs or a connection that is silent", () => {
  send({ kind: "retry" });
  vi.advanceTimersByTime(1000);
  expect(Socket.all.length).toBe(1); // it has just begun
  vi.advanceTimersByTime(1000);
  send({ kind: "retry" });
  vi.advanceTimersByTime(300);
  expect(Socket.all.length).toBe(2);
  Socket.all[1]?.open();
  vi.advanceTimersByTime(3000);
  expect(told.some(({ kind }) => kind === "silence")).toBe(true);
  send({ kind: "retry" });
  vi.advanceTimersByTime(300);
  expect(Socket.all.length).toBe(3);
  expect(states().at(-1)).toBe("connecting");
});

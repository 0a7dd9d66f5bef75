/// <reference lib="webworker" />
/**
 * The worker that keeps the connection to the server: it owns the WebSocket, decodes frames as they come, even while the page is
 * busy, and transfers typed arrays without a copy.
 *
 *     server ──WebSocket──▶ worker ──decode──▶ postMessage(frames, [buffer]) ──▶ page: Store ──▶ Ring
 *
 * Lost connections are retried after 0.25, 0.5, 1, 2, 4, 4 … s. After one, the page keeps its data and requests only the missed
 * seconds: sample numbers show exactly which samples it lacks. A restarted server has another `run`; then everything is dropped.
 */
import { TEXT } from "./texts";
import { localNow, ServerClock } from "./clock";
import { decode } from "./codec";
import { ASK_S, Silence, SILENT_S } from "./silence";
import type { FromWorker, ToWorker } from "./worker-messages";
import { SUBPROTOCOL } from "./frame";
import type { BrowserText, Dtype, ServerText } from "./types";
import { parseForeign } from "./foreign-text";

/** First and longest wait between attempts, s. Four seconds: a rebooted robot is on screen as soon as it listens. */
const FIRST_WAIT = 0.25;
const LONGEST_WAIT = 4;
/** Pings: frequent at first so that ages are right at once, then rare. */
const PING_FAST_S = 0.5;
const PING_SLOW_S = 5;
const FAST_PINGS = 6;
/** A server that has not answered for this long is given up: a pulled cable closes no socket by itself. */
const SILENCE_S = 15;
/** An attempt without an answer is given up, s: packets to a robot that is off are lost, and repeated more and more rarely. */
const ATTEMPT_S = 10;
/** Requested beyond the missed time: our newest sample may be older than the newest sent by the server. */
const MARGIN_S = 2;

const post = (message: FromWorker, transfer: Transferable[] = []): void => self.postMessage(message, { transfer });

let url = "";
let wanted = 0;
let interval = 0;
let socket: WebSocket | undefined;
let wait = FIRST_WAIT;
let retryTimer: ReturnType<typeof setTimeout> | undefined;
let pingTimer: ReturnType<typeof setTimeout> | undefined;
let pings = 0;
/** Last sign of life, or begin of the attempt. */
let received = 0;
let run: string | undefined;
let newest = -Infinity;
let historyComplete = false;
let stopped = true;
const clock = new ServerClock();
const silence = new Silence();
let listening: ReturnType<typeof setInterval> | undefined;
const dtypes = new Map<number, readonly Dtype[]>();

function send(text: BrowserText): void {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(text));
}

function connect(): void {
  clearTimeout(retryTimer);
  if (stopped) return;
  post({ kind: "connection", state: "connecting", nextTry: undefined });
  const mine = new WebSocket(url, SUBPROTOCOL);
  mine.binaryType = "arraybuffer";
  socket = mine;
  received = localNow();
  pingTimer = setTimeout(drop, 1000 * ATTEMPT_S);
  mine.onopen = () => {
    clearTimeout(pingTimer);
    receive();
    pings = 0;
    ping();
    clearInterval(listening);
    listening = setInterval(listen, 1000 * ASK_S);
  };
  mine.onmessage = (event: MessageEvent<ArrayBuffer | string>) => {
    receive();
    if (typeof event.data === "string") onText(event.data);
    else onBinary(event.data);
  };
  // An error is always followed by a close, and the browser does not say why: one handler is enough.
  mine.onclose = () => {
    if (socket !== mine) return;
    socket = undefined;
    clearTimeout(pingTimer);
    clearInterval(listening);
    if (stopped) return post({ kind: "connection", state: "closed", nextTry: undefined });
    post({ kind: "connection", state: "closed", nextTry: localNow() + wait });
    retryTimer = setTimeout(connect, wait * 1000);
    wait = Math.min(2 * wait, LONGEST_WAIT);
  };
}

function receive(): void {
  received = localNow();
  if (silence.receive(received)) post({ kind: "silence", since: undefined });
}

function listen(): void {
  const since = silence.ask(localNow());
  if (since === undefined) return;
  post({ kind: "silence", since });
  send({ op: "ping", t: localNow() }); // the answer ends the silence, and a socket without a route fails sooner
}

/** Give the connection up, or the attempt. */
function drop(): void {
  const dead = socket;
  dead?.close();
  dead?.onclose?.(new CloseEvent("close")); // close() waits for the other end, which does not answer
}

function ping(): void {
  if (localNow() - received > SILENCE_S) return drop();
  send({ op: "ping", t: localNow() });
  pings += 1;
  pingTimer = setTimeout(ping, 1000 * (pings < FAST_PINGS ? PING_FAST_S : PING_SLOW_S));
}

function subscribe(hello: Extract<ServerText, { op: "hello" }>): void {
  const fresh = hello.run !== run;
  run = hello.run;
  if (fresh) {
    dtypes.clear();
    clock.reset();
    newest = -Infinity;
  }
  const most = Math.min(wanted, hello.history);
  const missed = newest === -Infinity || !historyComplete ? most : hello.server_time - newest + MARGIN_S;
  historyComplete = false;
  post({ kind: "subscribed", fresh });
  if (interval > 0) send({ op: "interval", s: interval });
  send({ op: "subscribe", history: Math.max(0, Math.min(most, missed)), channels: null, units: "shown" });
}

function onText(data: string): void {
  let text: ServerText;
  try {
    text = parseForeign(data) as ServerText;
  } catch {
    return post({ kind: "problem", message: TEXT.invalidJson });
  }
  switch (text.op) {
    case "hello":
      wait = FIRST_WAIT;
      post({ kind: "connection", state: "open", nextTry: undefined });
      post({ kind: "text", text });
      return subscribe(text);
    case "channels":
      for (const channel of text.channels)
        dtypes.set(
          channel.id,
          channel.columns.map((column) => column.dtype),
        );
      break;
    case "pong": {
      clock.add(text.t, text.server_time, localNow());
      post({ kind: "round-trip", seconds: localNow() - text.t });
      const estimate = clock.estimate;
      if (estimate !== undefined) post({ kind: "clock", ...estimate });
      return;
    }
    case "history_end":
      historyComplete = true;
      break;
    default:
  }
  post({ kind: "text", text });
}

function onBinary(buffer: ArrayBuffer): void {
  const { frames, problem } = decode(buffer, (channel) => dtypes.get(channel));
  for (const frame of frames) {
    const last = frame.arrival[frame.n - 1];
    if (last !== undefined && last > newest) newest = last;
  }
  if (problem !== undefined) post({ kind: "problem", message: problem });
  if (frames.length > 0)
    post({ kind: "frames", frames, received: localNow() + (clock.estimate?.offset ?? NaN) }, [buffer]);
}

function stop(): void {
  stopped = true;
  clearTimeout(retryTimer);
  clearTimeout(pingTimer);
  clearInterval(listening);
  socket?.close();
}

self.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  switch (data.kind) {
    case "start":
      stop();
      url = data.url;
      wanted = data.history;
      stopped = false;
      wait = FIRST_WAIT;
      return connect();
    case "interval":
      interval = data.seconds;
      return send({ op: "interval", s: interval });
    case "retry":
      wait = FIRST_WAIT;
      if (socket === undefined) connect();
      else if (localNow() - received > SILENT_S) drop();
      return;
    case "stop":
      return stop();
  }
};

/**
 * The plots alone, fed by a synthetic device: `bench.html?mode=bench` fills six charts of three series with 100 000 points each in
 * view and measures; `bench.html` alone is for looking. Options: `rate` (samples/s), `span` (s in view), `lost=1`, `theme=light`.
 * Results of a measurement stand in `window.bench` once `window.bench.done` is true.
 *
 * Per frame two spans of script are timed: `draw`, the stack's update, and `feed`, the frame's new samples made, encoded, decoded and
 * put into rings. First come live frames, as one sees them: a window of 50 s moves by a pixel every fourth frame, and what
 * stands still is not drawn. `pan` frames move by a pixel every time, so that every frame draws everything; `zoom` frames change the
 * window's length, so that moreover no pixel can be kept from the frame before.
 */
import { onFrame } from "../data/render-loop";
import { Store } from "../data/store";
import { createViewState } from "../data/view-state";
import { localNow } from "../wire/clock";
import { mountStack } from "../plots/plot-stack";
import { CHANNELS, DEVICE, frameOf } from "./synthetic";
import "../ui/tokens.css";
import "../ui/base.css";
import "../ui/layout.css";
import "../ui/panels.css";
import "../ui/phone.css";
import "../ui/visibility.css";

interface Figures {
  readonly p50: number;
  readonly p95: number;
  readonly max: number;
}

const options = new URLSearchParams(location.search);
const option = (name: string, otherwise: number): number => Number(options.get(name) ?? otherwise);
const BENCH = options.get("mode") === "bench";
const RATE = option("rate", BENCH ? 2000 : 400);
const SPAN = option("span", BENCH ? 50 : 20);
/** Charts of the measurement: the five vectors with axes and one more make six of three series. */
const CHARTS: readonly number[] = [1, 2, 3, 6, 7, 8];
const FRAMES = option("frames", 600);
const BLOCK = 4000;
/** Frames of panning, and of zooming, after the live ones. */
const FORCED = 120;

const theme = options.get("theme");
if (theme !== null) document.documentElement.dataset["theme"] = theme;
const root = document.getElementById("root")!;
root.style.cssText = BENCH ? "position:fixed;inset:46px 296px 0 232px;display:flex" : "display:flex;height:100dvh";
root.classList.add("plot-host");

const store = new Store();
const viewState = createViewState();
const { view, actions } = viewState;
const channels = BENCH ? CHANNELS.filter(({ id }) => CHARTS.includes(id)) : CHANNELS;
store.receive({ kind: "subscribed", fresh: true });
store.receive({
  kind: "text",
  text: { op: "devices", devices: [{ ...DEVICE, status: options.has("lost") ? "lost" : "live" }] },
});
store.receive({ kind: "text", text: { op: "channels", channels } });
store.connection.value = "open";

// History newest block first, as the server sends it, then live samples as time goes by.
const now = localNow();
const origin = Math.round(now * RATE);
const total = Math.round((BENCH ? SPAN * 1.1 : 180) * RATE);
const times = (from: number, to: number): Float64Array =>
  Float64Array.from({ length: to - from }, (_, k) => (from + k) / RATE);
/** Lost on the way: rows of the demonstration that never come. */
const gapped = (t: number): boolean => !BENCH && t > now - 8 && t < now - 7.82;
const skip = (list: Float64Array): Float64Array => list.filter((t) => !gapped(t));
for (const info of channels) {
  const every = info.name === "BaroPressure" ? 8 : 1;
  for (let end = origin; end > origin - total; end -= BLOCK) {
    const list = skip(times(Math.max(origin - total, end - BLOCK), end)).filter((_, k) => k % every === 0);
    store.receive({ kind: "frames", frames: [frameOf(info, end - list.length, list, true)], received: NaN });
  }
}
if (!BENCH) {
  store.receive({
    kind: "text",
    text: {
      op: "events",
      events: [
        {
          seq: 1,
          time: now,
          device: "1",
          kind: "gap",
          level: "warning",
          text: "The packet counter jumped by 72.",
          t0: now - 8,
          t1: now - 7.82,
          samples: 72,
          data: {},
        },
      ],
    },
  });
}
let sent = origin;
function feed(): void {
  const upTo = Math.round(localNow() * RATE);
  if (upTo <= sent || options.has("lost")) return;
  const list = times(sent, upTo);
  store.receive({ kind: "frames", frames: channels.map((info) => frameOf(info, sent, list, false)), received: NaN });
  sent = upTo;
}

view.value = { ...view.peek(), device: "1", span: SPAN };
const stack = mountStack(root, { store, viewState });
if (BENCH)
  for (const button of [...root.querySelectorAll<HTMLButtonElement>(".more-quantities button")].map((_, k) => k))
    root.querySelectorAll<HTMLButtonElement>(".more-quantities button")[button]?.click();

const percentile = (list: number[], p: number): number =>
  [...list].sort((a, b) => a - b)[Math.min(list.length - 1, Math.floor(list.length * p))] ?? NaN;
const figures = (list: number[]): Figures => ({
  p50: percentile(list, 0.5),
  p95: percentile(list, 0.95),
  max: Math.max(...list),
});
const draws: number[] = [];
const pans: number[] = [];
const zooms: number[] = [];
const feeds: number[] = [];
const result = {
  done: false,
  frames: 0,
  points: 0,
  fps: NaN,
  draw: figures([0]),
  pan: figures([0]),
  zoom: figures([0]),
  feed: figures([0]),
};
let started = NaN;
let stopped = false;

onFrame((at) => {
  if (stopped) return;
  const t0 = performance.now();
  feed();
  const t1 = performance.now();
  const phase = result.frames < FRAMES ? "live" : result.frames < FRAMES + FORCED ? "pan" : "zoom";
  if (BENCH && phase === "pan") actions.panTo(actions.rightEdge() - SPAN / 700);
  if (BENCH && phase === "zoom") view.value = { ...view.peek(), span: SPAN * (0.9 + 0.1 * (result.frames % 2)) };
  stack.update(at);
  const t2 = performance.now();
  if (!BENCH) return;
  result.frames += 1;
  if (result.frames === 30) started = at; // compiled and filled by now
  if (result.frames <= 30) return;
  ({ live: draws, pan: pans, zoom: zooms })[phase].push(t2 - t1);
  feeds.push(t1 - t0);
  if (result.frames === FRAMES) result.fps = (1000 * (FRAMES - 30)) / (at - started);
  if (result.frames < FRAMES + 2 * FORCED) return;
  stopped = true;
  const shown = store.channels.peek().filter(({ info }) => CHARTS.includes(info.id));
  const from = store.serverNow() - SPAN;
  result.points = shown.reduce((sum, { ring }) => sum + 3 * (ring.end - ring.row(from, "device")), 0);
  Object.assign(result, {
    draw: figures(draws),
    pan: figures(pans),
    zoom: figures(zooms),
    feed: figures(feeds),
    done: true,
  });
});
Object.assign(window, { bench: result, imuscope: { store, ...viewState } });

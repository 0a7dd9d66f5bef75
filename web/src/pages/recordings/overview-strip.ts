/**
 * Overview of the whole recording: the motion of the first two quantities, the worst device status, losses, markers, the loop, the
 * window on screen, and the reading position. Pressing and dragging moves it; with Shift it selects the loop.
 */
import { effect } from "@preact/signals";
import { lossMarks } from "../../plots/loss-marks";
import { fitting, hatch, onLook, palette, type Palette, setFont, CanvasLayer } from "../../plots/canvas-style";
import { protocolAmong } from "../../wire/capabilities";
import { usualPlots } from "../../signals/plot-selection";
import { decode } from "../../wire/codec";
import { length } from "../../recordings/library-filter";
import { motionOf, worstOf } from "../../recordings/overview-data";
import type { ReplayController } from "../../recordings/replay-controller";
import { fetchWindow } from "../../recordings/api";
import { el, type Panel } from "../../ui/dom/dom";
import { span as spanOf } from "../../ui/format/format";
import { TEXT } from "../../texts/recordings";

/** Parts of the recording: more than a strip has pixels of bars. */
const STRIP_PARTS = 900;
const LOSS_PX = 2;
const FLAGS_PX = 18;
const AXIS_PX = 20;
const STATUS_PX = 12;
/** Less room is one quantity's alone. */
const LEAST_ROW_PX = 20;
/** Steps between the marks of its axis, s. */
const STEPS: readonly number[] = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400];
/** A press that moved less than this selects no range, px. */
const CLICK_PX = 4;

interface Row {
  readonly title: string;
  readonly motion: Float64Array;
}

export function mountOverview(host: HTMLElement, replay: ReplayController): Panel {
  const sheet = new CanvasLayer(el("canvas", { role: "img", "aria-label": TEXT.overviewLabel }));
  host.append(sheet.canvas);
  const { first, last } = replay.bounds;
  let look = palette(host);
  let rows: readonly Row[] = [];
  let worst = new Uint8Array(0);
  let stamp = "";
  let version = 0;
  const stop = new AbortController();
  const relook = (): void => {
    look = palette(host);
    sheet.resize(host.clientWidth, host.clientHeight);
    version += 1;
  };
  const unfollow = onLook(host, relook);

  let of: string | undefined;
  const load = async (device: string): Promise<void> => {
    const own = replay.drawn.channels.value.filter(({ info }) => info.device === device && info.id >= 0);
    const two = usualPlots(own, protocolAmong(replay.drawn.devices.peek(), device)?.plots)
      .filter(({ primary }) => primary)
      .slice(0, 2);
    const moving = two.flatMap(({ title, series }) => {
      const of = series[0]?.channel;
      if (of === undefined) return [];
      const columns = series.filter(({ channel, norm }) => channel === of && !norm).map(({ column }) => column);
      return [{ title, id: of.info.id, columns }];
    });
    const status = own.filter(({ info }) => info.kind === "status").map(({ info }) => info);
    const channels = [...new Set([...moving, ...status].map(({ id }) => id))];
    if (channels.length === 0) return;
    const answer = await fetchWindow(
      replay.detail.info.id,
      { t0: first, t1: last, width: STRIP_PARTS, base: "device", channels },
      stop.signal,
    ).catch(() => undefined);
    if (answer === undefined || "message" in answer || of !== device) return;
    const { frames } = decode(answer.buffer, replay.drawn.dtypesOf);
    const frameOf = (id: number) => frames.find(({ channel }) => channel === id);
    rows = moving.flatMap(({ title, id, columns }) => {
      const frame = frameOf(id);
      return frame ? [{ title, motion: motionOf(frame, columns, [first, last], STRIP_PARTS) }] : [];
    });
    worst = new Uint8Array(STRIP_PARTS);
    for (const info of status) {
      const frame = frameOf(info.id);
      if (frame) worstOf(info, frame, [first, last], worst);
    }
    version += 1;
  };
  let decoded = NaN;
  const unwatch = effect(() => {
    const device = replay.viewState.device.value;
    const progress = replay.progress.value;
    if (device === undefined || (device === of && progress === decoded)) return;
    [of, decoded] = [device, progress];
    void load(device);
  });

  const left = (): number => (look.narrow ? 14 : look.gutter);
  const width = (): number => sheet.width - left() - (look.narrow ? 14 : look.tail);
  const timeAt = (event: PointerEvent): number =>
    first + ((event.clientX - host.getBoundingClientRect().left - left()) / Math.max(1, width())) * (last - first);
  let press: { readonly id: number; readonly x: number; readonly t: number; readonly shift: boolean } | undefined;
  const on = (
    name: "pointerdown" | "pointermove" | "pointerup" | "pointercancel",
    run: (event: PointerEvent) => void,
  ): void => sheet.canvas.addEventListener(name, run, { signal: stop.signal });
  on("pointerdown", (event) => {
    if (event.button !== 0) return;
    sheet.canvas.setPointerCapture(event.pointerId);
    press = { id: event.pointerId, x: event.clientX, t: timeAt(event), shift: event.shiftKey };
    if (!press.shift) replay.seek(press.t);
  });
  on("pointermove", (event) => {
    if (press?.id !== event.pointerId) return;
    if (!press.shift) return replay.seek(timeAt(event));
    if (Math.abs(event.clientX - press.x) < CLICK_PX) return;
    const [a, b] = [press.t, timeAt(event)].sort((p, q) => p - q) as [number, number];
    replay.loop.value = [Math.max(a, first), Math.min(b, last)];
    replay.looping.value = true;
  });
  const end = (): void => {
    press = undefined;
  };
  on("pointerup", end);
  on("pointercancel", end);

  return {
    update() {
      const { end: right, span, device } = replay.viewState.view.peek();
      const losses = replay.drawn.losses(device ?? "");
      const loop = replay.looping.peek() ? replay.loop.peek() : undefined;
      const next = `${version} ${right} ${span} ${replay.head} ${loop} ${losses.length} ${replay.markers.peek().length}`;
      if (next === stamp || sheet.height < 20) return;
      stamp = next;
      draw(sheet, look, {
        first,
        last,
        left: left(),
        width: width(),
        rows,
        worst,
        losses,
        markers: replay.markers.peek(),
        loop,
        t0: right - span,
        t1: right,
        head: replay.head,
      });
    },
    dispose() {
      stop.abort();
      unwatch();
      unfollow();
      sheet.canvas.remove();
    },
  };
}

interface Scene {
  readonly first: number;
  readonly last: number;
  readonly left: number;
  readonly width: number;
  readonly rows: readonly Row[];
  readonly worst: Uint8Array;
  readonly losses: readonly { readonly t0: number; readonly t1: number }[];
  readonly markers: readonly { readonly time: number; readonly text: string }[];
  readonly loop: readonly [number, number] | undefined;
  readonly t0: number;
  readonly t1: number;
  readonly head: number;
}

function draw(sheet: CanvasLayer, look: Palette, scene: Scene): void {
  const x = sheet.begin();
  const { first, last, left, width } = scene;
  const at = (t: number): number => left + ((Math.min(last, Math.max(first, t)) - first) / (last - first)) * width;
  const [top, bottom] = [FLAGS_PX, sheet.height - AXIS_PX];
  drawRows(x, look, scene, top, bottom - STATUS_PX - 4, at);
  drawStatus(x, look, scene, bottom - STATUS_PX);
  drawLosses(x, look, scene, top, bottom, at);
  drawLoop(x, look, scene, top, bottom, at);
  drawWindow(x, look, scene, top, bottom, at);
  drawMarkers(x, look, scene, bottom, at);
  drawAxis(x, look, scene, sheet.height - AXIS_PX / 2 + 1);
  drawHead(x, look, scene, sheet.height, at);
}

type X = CanvasRenderingContext2D;
type At = (t: number) => number;

function drawRows(
  x: X,
  look: Palette,
  { rows: all, left, width, first, last, t0, t1 }: Scene,
  top: number,
  bottom: number,
  at: At,
): void {
  const rows = all.slice(0, Math.max(1, Math.floor((bottom - top) / LEAST_ROW_PX)));
  const tall = (bottom - top) / Math.max(1, rows.length);
  const step = width / STRIP_PARTS;
  const [a, b] = [at(t0), at(t1)];
  const whole = t0 <= first && t1 >= last;
  rows.forEach(({ title, motion }, k) => {
    const middle = top + (k + 0.5) * tall;
    motion.forEach((v, i) => {
      if (v !== v) return;
      const px = left + i * step;
      const height = Math.max(1.2, v * (tall - 4));
      x.fillStyle = look.colour[px >= a - step && px <= b && !whole ? "ink-2" : "ink-3"];
      x.fillRect(px, middle - height / 2, Math.max(0.6, step * 0.8), height);
    });
    if (look.narrow) return;
    setFont(x, look, 11);
    [x.textAlign, x.textBaseline, x.fillStyle] = ["left", "middle", look.colour["ink-2"]];
    x.fillText(title, 16, middle, left - 24);
  });
}

function drawStatus(x: X, look: Palette, { worst, left, width }: Scene, y: number): void {
  x.fillStyle = look.colour["bg-hover"];
  x.fillRect(left, y, width, STATUS_PX - 4);
  const step = width / STRIP_PARTS;
  worst.forEach((level, i) => {
    if (level === 0) return;
    x.fillStyle = look.colour[level === 2 ? "status-bad" : "status-warn"];
    x.fillRect(left + i * step, y, Math.max(LOSS_PX, step), STATUS_PX - 4);
  });
  if (look.narrow) return;
  setFont(x, look, 11);
  [x.textAlign, x.textBaseline, x.fillStyle] = ["left", "middle", look.colour["ink-3"]];
  x.fillText(TEXT.worstStatus, 16, y + 4);
}

function drawLosses(x: X, look: Palette, { losses }: Scene, top: number, bottom: number, at: At): void {
  x.fillStyle = hatch(x, look.colour.loss, 4);
  const placed = losses.map(({ t0, t1 }) => [at(t0), at(t1)] as const);
  for (const { from, to, share } of lossMarks(placed, LOSS_PX)) {
    x.globalAlpha = share;
    x.fillRect(from, top, to - from, bottom - top);
  }
  x.globalAlpha = 1;
  x.fillStyle = look.colour.loss;
  for (const { t0, t1 } of losses)
    x.fillRect((at(t0) + at(t1) - LOSS_PX) / 2, bottom - STATUS_PX - 2, LOSS_PX, STATUS_PX);
}

function drawLoop(x: X, look: Palette, { loop }: Scene, top: number, bottom: number, at: At): void {
  if (!loop) return;
  const [a, b] = [at(loop[0]), at(loop[1])];
  x.fillStyle = look.colour.yours;
  x.globalAlpha = 0.16;
  x.fillRect(a, top, Math.max(2, b - a), bottom - top);
  x.globalAlpha = 1;
  for (const [px, inward] of [
    [a, 1],
    [b, -1],
  ] as const) {
    x.fillRect(px - 1, top, 2, bottom - top);
    x.fillRect(inward > 0 ? px : px - 6, top, 6, 2);
    x.fillRect(inward > 0 ? px : px - 6, bottom - 2, 6, 2);
  }
}

function drawWindow(x: X, look: Palette, { t0, t1, first, last }: Scene, top: number, bottom: number, at: At): void {
  if (t0 <= first && t1 >= last) return;
  const [a, b] = [at(t0), at(t1)];
  const wide = Math.max(4, b - a);
  x.strokeStyle = x.fillStyle = look.colour.ink;
  x.lineWidth = 1.25;
  x.globalAlpha = 0.08;
  x.fillRect((a + b - wide) / 2, top, wide, bottom - top);
  x.globalAlpha = 1;
  x.beginPath();
  x.roundRect((a + b - wide) / 2 + 0.5, top + 0.5, wide - 1, bottom - top - 1, 2);
  x.stroke();
}

function drawMarkers(x: X, look: Palette, { markers, left, width }: Scene, bottom: number, at: At): void {
  setFont(x, look, 11);
  [x.textAlign, x.textBaseline] = ["left", "middle"];
  const sorted = [...markers].sort((a, b) => a.time - b.time);
  sorted.forEach(({ time, text }, k) => {
    const px = at(time);
    x.fillStyle = look.colour.yours;
    x.fillRect(px - 0.5, 4, 1, bottom - 4);
    x.beginPath();
    x.moveTo(px, 3);
    x.lineTo(px + 8, 7);
    x.lineTo(px, 11);
    x.fill();
    const next = sorted[k + 1];
    const room = (next ? at(next.time) : left + width + 30) - px - 16;
    if (text === "" || room < 24) return;
    x.fillStyle = look.colour["ink-2"];
    x.fillText(fitting(x, text, room), px + 11, 8);
  });
}

function drawAxis(x: X, look: Palette, { first, last, left, width, head }: Scene, y: number): void {
  const whole = last - first;
  const step = STEPS.find((seconds) => whole / seconds <= (look.narrow ? 4 : 9)) ?? whole / 8;
  setFont(x, look, 10.5);
  [x.textBaseline, x.fillStyle] = ["middle", look.colour["ink-3"]];
  const here = left + ((head - first) / whole) * width;
  for (let t = 0; t <= whole * 1.0001; t += step) {
    const px = left + (t / whole) * width;
    if (Math.abs(px - here) < 62) continue;
    x.textAlign = px > left + width - 30 ? "right" : t === 0 ? "left" : "center";
    const { value, unit } = spanOf(t);
    x.fillText(t === 0 ? "0" : `${value} ${unit}`, px, y);
  }
}

function drawHead(x: X, look: Palette, { first, head, left, width }: Scene, height: number, at: At): void {
  const px = at(head);
  x.fillStyle = look.colour.ink;
  x.fillRect(px - 0.75, FLAGS_PX - 4, 1.5, height - AXIS_PX - FLAGS_PX + 4);
  setFont(x, look, 11, 600);
  const text = length(head - first, 3);
  const wide = x.measureText(text).width + 12;
  const from = Math.min(Math.max(px - wide / 2, left - 10), left + width + 10 - wide);
  x.fillStyle = look.colour["invert-bg"];
  x.beginPath();
  x.roundRect(from, height - AXIS_PX + 1, wide, AXIS_PX - 3, 3);
  x.fill();
  [x.textAlign, x.textBaseline, x.fillStyle] = ["center", "middle", look.colour.bg];
  x.fillText(text, from + wide / 2, height - AXIS_PX / 2);
}
